"""A Kalman filter and the smoother of Rauch, Tung and Striebel for points, each by itself, over true times.

State: position and velocity; accelerations are white. Source: Rauch, Tung & Striebel 1965, "Maximum likelihood
estimates of linear dynamic systems"; Bar-Shalom, Li & Kirubarajan 2001, section 6.2 for the discretised law of motion.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.model.options.postprocess import KalmanOptions
from posefuse.model.reconstruction import unpack_covariance
from posefuse.postprocess.points import Clock, Points

_GROUP = 32
"""So many points at a time: what is kept of every frame for the way back is large."""

_SPEED_SD_M_S = 5.0
_PACKED = ((0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2))
_MEMORIES = 60.0


@dataclass(frozen=True, eq=False)
class _Belief:
    """Positions and velocities: means (..., 6) and covariances (..., 6, 6)."""

    mean: np.ndarray
    covariance: np.ndarray

    @classmethod
    def room(cls, frames: int, points: int) -> Self:
        return cls(np.zeros((frames, points, 6)), np.zeros((frames, points, 6, 6)))

    def put(self, frame: int, belief: "_Belief") -> None:
        self.mean[frame], self.covariance[frame] = belief.mean, belief.covariance

    def at(self, frame: int) -> "_Belief":
        return _Belief(self.mean[frame], self.covariance[frame])


def smoothed(points: Points, clock: Clock, options: KalmanOptions) -> Points:
    """Where points were, by all of them, also in their gaps.

    Points without a covariance count as missing.

    Args:
        points: as measured.
        clock: of their frames; where a time is unknown nothing is known.
        options: how points move, and how long their errors last.

    Returns:
        The points between each one's first and last, with covariance; sources are those given.
    """
    timed = np.isfinite(clock.time_s)
    xyz, covariance = np.full_like(points.xyz_m, np.nan), np.full_like(points.covariance_m2, np.nan)
    factor = tempering(clock.period_s, options.error_memory_s)
    for start in range(0, points.xyz_m.shape[1], _GROUP):
        to = slice(start, start + _GROUP)
        measured, errors = points.xyz_m[timed, to], factor * unpack_covariance(points.covariance_m2[timed, to])
        xyz[timed, to], covariance[timed, to] = _smooth(measured, errors, clock.time_s[timed], options.acceleration)
    return Points(xyz, covariance, points.source)


def tempering(period_s: float, memory_s: float) -> float:
    """By how much the variance of the mean of many errors grows when they last: (1 + r) / (1 - r), r = exp(-dt / m)."""
    if memory_s <= 0.0 or period_s / memory_s > _MEMORIES:
        return 1.0
    kept = float(np.exp(-period_s / memory_s))
    return (1.0 + kept) / (1.0 - kept)


def _smooth(
    measured: np.ndarray, errors: np.ndarray, time_s: np.ndarray, acceleration: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points and packed covariances, NaN before the first and after the last measured one."""
    known = np.asarray(np.isfinite(measured).all(axis=-1) & np.isfinite(errors).all(axis=(-1, -2)))
    frames, n_points = known.shape
    steps_s = np.diff(time_s, prepend=time_s[:1])
    filtered, foretold = _Belief.room(frames, n_points), _Belief.room(frames, n_points)
    begun = np.zeros(n_points, dtype=bool)
    now = _unknown(n_points)
    for f in range(frames):
        now = _predicted(now, float(steps_s[f]), acceleration)
        _begin(now, measured[f], known[f] & ~begun)
        begun |= known[f]
        foretold.put(f, now)
        now = _updated(now, measured[f], errors[f], known[f])
        filtered.put(f, now)
    _carry_back(filtered, foretold, steps_s)
    inside = np.maximum.accumulate(known, axis=0) & np.maximum.accumulate(known[::-1], axis=0)[::-1]
    packed = filtered.covariance[..., _PACKED[0], _PACKED[1]]
    return np.where(inside[..., None], filtered.mean[..., :3], np.nan), np.where(inside[..., None], packed, np.nan)


def _unknown(n_points: int) -> _Belief:
    return _Belief(np.zeros((n_points, 6)), np.tile(np.eye(6), (n_points, 1, 1)))


def _begin(now: _Belief, measured: np.ndarray, new: np.ndarray) -> None:
    """Points seen for the first time: about there, at any speed, whatever was foretold; in place."""
    now.mean[new] = np.concatenate([measured[new], np.zeros((int(new.sum()), 3))], axis=-1)
    # A metre is nothing known, and small enough beside the millimetres of the errors to lose no digits.
    now.covariance[new] = np.diag([1.0] * 3 + [_SPEED_SD_M_S**2] * 3)


def _predicted(now: _Belief, step_s: float, acceleration: float) -> _Belief:
    position, velocity = now.mean[:, :3], now.mean[:, 3:]
    mean = np.concatenate([position + step_s * velocity, velocity], axis=-1)
    covariance = now.covariance.copy()
    covariance[:, :3] += step_s * covariance[:, 3:]
    covariance[:, :, :3] += step_s * covariance[:, :, 3:]
    walk = acceleration * np.array([[step_s**3 / 3.0, step_s**2 / 2.0], [step_s**2 / 2.0, step_s]])
    return _Belief(mean, covariance + np.kron(walk, np.eye(3)))


def _updated(now: _Belief, measured: np.ndarray, errors: np.ndarray, known: np.ndarray) -> _Belief:
    """The belief with a frame's measurements taken in, where there are any."""
    if not known.any():
        return now
    mean, covariance = now.mean.copy(), now.covariance.copy()
    p = covariance[known]
    gain = np.linalg.solve(p[:, :3, :3] + errors[known], p[:, :3]).transpose(0, 2, 1)
    mean[known] += np.einsum("nij,nj->ni", gain, measured[known] - mean[known, :3])
    # Joseph's form stays symmetric and positive whatever the rounding.
    rest = np.eye(6) - np.concatenate([gain, np.zeros_like(gain)], axis=-1)
    covariance[known] = rest @ p @ rest.transpose(0, 2, 1) + gain @ errors[known] @ gain.transpose(0, 2, 1)
    return _Belief(mean, covariance)


def _carry_back(filtered: _Belief, foretold: _Belief, steps_s: np.ndarray) -> None:
    """Correct what was filtered by what came after, last frame first, in place."""
    for f in range(len(steps_s) - 2, -1, -1):
        here, later, guess = filtered.at(f), filtered.at(f + 1), foretold.at(f + 1)
        moved = here.covariance.copy()
        moved[:, :3] += steps_s[f + 1] * moved[:, 3:]
        gain = np.linalg.solve(guess.covariance, moved).transpose(0, 2, 1)
        mean = here.mean + np.einsum("nij,nj->ni", gain, later.mean - guess.mean)
        covariance = here.covariance + gain @ (later.covariance - guess.covariance) @ gain.transpose(0, 2, 1)
        filtered.put(f, _Belief(mean, 0.5 * (covariance + covariance.transpose(0, 2, 1))))
