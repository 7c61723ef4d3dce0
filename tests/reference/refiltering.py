"""Refiltering of one person with discounted information, frame by frame with dense matrices."""

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.tracking.body_states import select_states, set_state
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.tempering import bone_axes, frame_information, temper_next_state


def refilter(
    filtered: State,
    time_s: np.ndarray,
    share: np.ndarray,
    information_factor: np.ndarray,
    first: State,
    settings: TrackerSettings,
) -> tuple[State, np.ndarray]:
    """As posefuse.tracking.tempering has it."""
    before, after = (State(*(each[to] for each in filtered)) for to in (slice(-1), slice(1, None)))
    messages = frame_information(before, np.diff(time_s), after, settings)
    out = select_states(filtered, np.arange(len(time_s)))
    set_state(out, 0, first)
    for k in range(1, len(time_s)):
        observed = select_states(filtered, [k])
        now = temper_next_state(
            select_states(out, [k - 1]), time_s[k] - time_s[k - 1], observed, messages.curvature[k - 1],
            messages.gradient[k - 1], share[k], settings,
        )  # fmt: skip
        set_state(out, k, now)
    turn = bone_axes(out, filtered, settings)
    information = np.zeros((len(time_s), *messages.curvature.shape[1:]))
    information[1:] = information_factor[1:, None, None] * (turn.transpose(0, 2, 1)[1:] @ messages.curvature @ turn[1:])
    return out, information
