"""Kalman filter and Rauch-Tung-Striebel smoother for individual points, with actual frame times.

The state is position and velocity; accelerations are white noise. Sources: Rauch, Tung and Striebel 1965, "Maximum
likelihood estimates of linear dynamic systems"; Bar-Shalom, Li and Kirubarajan 2001, section 6.2, for the discretized
motion model.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.model.options.postprocess import KalmanOptions
from posefuse.model.reconstruction import unpack_covariance
from posefuse.model.status import Source
from posefuse.postprocess.points import Clock, Points

_BATCH = 32
"""Number of points per batch, which limits the memory of the backward pass."""

_SPEED_SD_M_S = 5.0
_PACKED = ((0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2))
_MAX_DECAY = 60.0


@dataclass(frozen=True, eq=False)
class _Estimates:
    """Hold positions and velocities: means (..., 6) and covariances (..., 6, 6)."""

    mean: np.ndarray
    covariance: np.ndarray

    @classmethod
    def allocate(cls, frames: int, points: int) -> Self:
        """Allocate estimates of all frames."""
        return cls(np.zeros((frames, points, 6)), np.zeros((frames, points, 6, 6)))

    def put(self, frame: int, estimates: "_Estimates") -> None:
        """Store the estimates of one frame."""
        self.mean[frame], self.covariance[frame] = estimates.mean, estimates.covariance

    def at(self, frame: int) -> "_Estimates":
        """Return the estimates of one frame."""
        return _Estimates(self.mean[frame], self.covariance[frame])


def smooth_kalman(points: Points, clock: Clock, options: KalmanOptions) -> Points:
    """Estimate points from all their measurements, also inside gaps.

    Filled points are not measurements, so they count as missing.

    Args:
        points: measured points.
        clock: of their frames; frames without a time are missing.
        options: motion model and correlation time of the errors.

    Returns:
        Points between the first and the last measurement, with covariances; sources are those given.
    """
    timed = np.isfinite(clock.time_s)
    measurements = np.where((points.source == Source.FILLED)[..., None], np.nan, points.xyz_m)
    xyz, covariance = np.full_like(points.xyz_m, np.nan), np.full_like(points.covariance_m2, np.nan)
    factor = tempering(clock.period_s, options.error_memory_s)
    for start in range(0, points.xyz_m.shape[1], _BATCH):
        batch = slice(start, start + _BATCH)
        measured, errors = measurements[timed, batch], factor * unpack_covariance(points.covariance_m2[timed, batch])
        xyz[timed, batch], covariance[timed, batch] = _smooth(
            measured, errors, clock.time_s[timed], options.acceleration
        )
    return Points(xyz, covariance, points.source)


def tempering(period_s: float, memory_s: float) -> float:
    """Return the factor by which the variance of a mean grows for correlated errors.

    It is (1 + r) / (1 - r) with r = exp(-dt / memory).
    """
    if memory_s <= 0.0 or period_s / memory_s > _MAX_DECAY:
        return 1.0
    correlation = float(np.exp(-period_s / memory_s))
    return (1.0 + correlation) / (1.0 - correlation)


def _smooth(
    measured: np.ndarray, errors: np.ndarray, time_s: np.ndarray, acceleration: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return points and packed covariances, NaN before the first and after the last measurement."""
    known = np.asarray(np.isfinite(measured).all(axis=-1) & np.isfinite(errors).all(axis=(-1, -2)))
    frames, n_points = known.shape
    steps_s = np.diff(time_s, prepend=time_s[:1])
    filtered, predicted = _Estimates.allocate(frames, n_points), _Estimates.allocate(frames, n_points)
    started = np.zeros(n_points, dtype=bool)
    current = _initial(n_points)
    for f in range(frames):
        current = _predict(current, float(steps_s[f]), acceleration)
        _start_points(current, measured[f], known[f] & ~started)
        started |= known[f]
        predicted.put(f, current)
        current = _update(current, measured[f], errors[f], known[f])
        filtered.put(f, current)
    _smooth_backward(filtered, predicted, steps_s)
    inside = np.maximum.accumulate(known, axis=0) & np.maximum.accumulate(known[::-1], axis=0)[::-1]
    packed = filtered.covariance[..., _PACKED[0], _PACKED[1]]
    return np.where(inside[..., None], filtered.mean[..., :3], np.nan), np.where(inside[..., None], packed, np.nan)


def _initial(n_points: int) -> _Estimates:
    """Return estimates before any measurement."""
    return _Estimates(np.zeros((n_points, 6)), np.tile(np.eye(6), (n_points, 1, 1)))


def _start_points(current: _Estimates, measured: np.ndarray, new: np.ndarray) -> None:
    """Initialize points at their first measurement with unknown velocity, in place."""
    current.mean[new] = np.concatenate([measured[new], np.zeros((int(new.sum()), 3))], axis=-1)
    # 1 m is uninformative, and small enough compared with errors of millimeters to lose no digits.
    current.covariance[new] = np.diag([1.0] * 3 + [_SPEED_SD_M_S**2] * 3)


def _predict(current: _Estimates, step_s: float, acceleration: float) -> _Estimates:
    """Return the estimates after a time step."""
    position, velocity = current.mean[:, :3], current.mean[:, 3:]
    mean = np.concatenate([position + step_s * velocity, velocity], axis=-1)
    covariance = current.covariance.copy()
    covariance[:, :3] += step_s * covariance[:, 3:]
    covariance[:, :, :3] += step_s * covariance[:, :, 3:]
    process_noise = acceleration * np.array([[step_s**3 / 3.0, step_s**2 / 2.0], [step_s**2 / 2.0, step_s]])
    return _Estimates(mean, covariance + np.kron(process_noise, np.eye(3)))


def _update(current: _Estimates, measured: np.ndarray, errors: np.ndarray, known: np.ndarray) -> _Estimates:
    """Return the estimates updated with a frame's measurements."""
    if not known.any():
        return current
    mean, covariance = current.mean.copy(), current.covariance.copy()
    p = covariance[known]
    gain = np.linalg.solve(p[:, :3, :3] + errors[known], p[:, :3]).transpose(0, 2, 1)
    mean[known] += np.einsum("nij,nj->ni", gain, measured[known] - mean[known, :3])
    # The Joseph form stays symmetric and positive under rounding.
    remainder = np.eye(6) - np.concatenate([gain, np.zeros_like(gain)], axis=-1)
    covariance[known] = remainder @ p @ remainder.transpose(0, 2, 1) + gain @ errors[known] @ gain.transpose(0, 2, 1)
    return _Estimates(mean, covariance)


def _smooth_backward(filtered: _Estimates, predicted: _Estimates, steps_s: np.ndarray) -> None:
    """Correct filtered estimates by later ones, from the last frame to the first, in place."""
    for f in range(len(steps_s) - 2, -1, -1):
        filtered_now, smoothed_next, predicted_next = filtered.at(f), filtered.at(f + 1), predicted.at(f + 1)
        cross_covariance = filtered_now.covariance.copy()
        cross_covariance[:, :3] += steps_s[f + 1] * cross_covariance[:, 3:]
        gain = np.linalg.solve(predicted_next.covariance, cross_covariance).transpose(0, 2, 1)
        mean = filtered_now.mean + np.einsum("nij,nj->ni", gain, smoothed_next.mean - predicted_next.mean)
        covariance = filtered_now.covariance + gain @ (
            smoothed_next.covariance - predicted_next.covariance
        ) @ gain.transpose(0, 2, 1)
        filtered.put(f, _Estimates(mean, 0.5 * (covariance + covariance.transpose(0, 2, 1))))
