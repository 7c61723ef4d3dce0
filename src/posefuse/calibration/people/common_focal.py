"""Common factor of unknown focal lengths: a search along the likelihood of cameras, integrated over all bodies.

A bundle adjustment of bodies and cameras together makes focal lengths too short: near and wide views let bones absorb
the errors of detections. The integral does not (:mod:`.likelihood`), but has no simple derivatives.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from posefuse.calibration.people.bodies import BodySamples, Bones
from posefuse.calibration.people.body_bundle import BodyState, adjust_bodies
from posefuse.calibration.people.likelihood import camera_costs
from posefuse.kernels.calibration.body_bundle import FOCAL

_STEP, _MOST_STEPS = 0.15, 6
_SD = 0.4
"""Standard deviation of the logarithm of a focal length around the larger side of the image: 35 to 75 degrees."""
_INDEPENDENT = 0.1
"""Share of independent observations: errors persist over time."""
_ROUNDS = 2


def with_common_focal(samples: BodySamples, bones: Bones, state: BodyState, free: np.ndarray) -> BodyState:
    """Return the state at the most probable common factor of the focal lengths that are free.

    Args:
        samples: observations.
        bones: bones of the skeleton.
        state: initial parameters.
        free: shape (view, VIEW_COLUMNS), bool: free parameters of the views.
    """
    unknown = free[:, FOCAL]
    if not unknown.any():
        return state
    held = free.copy()
    held[:, FOCAL] = False
    found: dict[int, tuple[float, BodyState]] = {}

    def at(k: int, near: BodyState) -> tuple[float, BodyState]:
        if k not in found:
            there = adjust_bodies(samples, bones, _zoomed(near, unknown, state.log_focal + k * _STEP), held, _ROUNDS)
            middle = float(there.log_focal[unknown].mean())
            cost = _INDEPENDENT * float(camera_costs(samples, bones, there).sum()) + 0.5 * (middle / _SD) ** 2
            found[k] = cost, there
        return found[k]

    best = _lowest(at, state)
    return found[best][1]


def _zoomed(state: BodyState, unknown: np.ndarray, log_focal: np.ndarray) -> BodyState:
    """Return the state at other focal lengths, with cameras at distances from which people are as large as before."""
    log_focal = np.where(unknown, log_focal, state.log_focal)
    middle = np.nanmedian(state.points.reshape(-1, 3), axis=0)
    farther = np.exp(log_focal - state.log_focal)[:, None]
    return replace(state, log_focal=log_focal, centers=middle + farther * (state.centers - middle))


def _lowest(at: Callable[[int, BodyState], tuple[float, BodyState]], state: BodyState) -> int:
    """Return the step with the lowest cost, going downhill from 0."""
    best = 0
    cost, near = at(0, state)
    for direction in (-1, 1):
        while abs(best + direction) <= _MOST_STEPS:
            other, there = at(best + direction, near)
            if other >= cost:
                break
            best, cost, near = best + direction, other, there
    return best
