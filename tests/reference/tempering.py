"""A person filtered again, frame by frame with dense matrices."""

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.tracking.body_states import chosen, put
from posefuse.tracking.settings import Settings
from posefuse.tracking.tempering import bone_axes, next_with, what_was_said


def tell_again(
    filtered: State, time_s: np.ndarray, share: np.ndarray, told: np.ndarray, first: State, settings: Settings
) -> tuple[State, np.ndarray]:
    """As posefuse.tracking.tempering has it."""
    before, after = (State(*(each[to] for each in filtered)) for to in (slice(-1), slice(1, None)))
    said = what_was_said(before, np.diff(time_s), after, settings)
    out = chosen(filtered, np.arange(len(time_s)))
    put(out, 0, first)
    for k in range(1, len(time_s)):
        seen = chosen(filtered, [k])
        now = next_with(
            chosen(out, [k - 1]), time_s[k] - time_s[k - 1], seen, said.curvature[k - 1], said.gradient[k - 1],
            share[k], settings,
        )  # fmt: skip
        put(out, k, now)
    turn = bone_axes(out, filtered, settings)
    information = np.zeros((len(time_s), *said.curvature.shape[1:]))
    information[1:] = told[1:, None, None] * (turn.transpose(0, 2, 1)[1:] @ said.curvature @ turn[1:])
    return out, information
