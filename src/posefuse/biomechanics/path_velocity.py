"""Estimate the velocity on a path by local polynomials, with the standard deviation under correlated errors."""

from dataclasses import dataclass

import numpy as np

from posefuse.model.options.options import LayerName

_HALF_S = 0.06
"""Half of the window of the local polynomial."""
_HALF_FRAMES = 1.5
"""Half of the window in frames, at low frame rates."""
_MAX_HALF_S = 0.2
"""Largest half of the window; frames that are farther apart have no velocity."""
_TOLERANCE = 1.0 + 1e-6
_TERMS = 3
_MEMORY_S: dict[LayerName, float] = {"measured": 0.15, "solved": 0.083, "model": 0.115}
"""Correlation time of the errors of the center of mass."""
_SMOOTHED: dict[LayerName, float] = {"measured": 0.0, "solved": 0.7, "model": 0.2}
"""Error of the velocity by smoothing, as a share of the second difference of the velocity over ``_CHANGE_S``."""
_CHANGE_S = 0.1
_LASTING = 0.85
"""Share of the variance of measured points that persists to the next frame."""


@dataclass(frozen=True)
class VelocityWindow:
    """Describe which frames the velocity of a frame is estimated from; all numbers are 0 if none can be.

    Attributes:
        half_s: half of the window of the local polynomial.
        neighbors: largest number of frames in it on either side.
        change: number of frames after which the velocity is compared.
    """

    half_s: float
    neighbors: int
    change: int

    @classmethod
    def of(cls, time_s: np.ndarray) -> "VelocityWindow":
        """Return the window for the times of all frames, shape (frame,), NaN if unknown."""
        steps = np.diff(time_s)
        if not len(steps) or not np.isfinite(steps).all() or (steps <= 0).any():
            return cls(0.0, 0, 0)
        step = float(np.median(steps))
        half = max(_HALF_S, _HALF_FRAMES * step) * _TOLERANCE
        if half > _MAX_HALF_S * _TOLERANCE:
            return cls(0.0, 0, 0)
        inside = np.searchsorted(time_s, time_s + half, side="right") - 1 - np.arange(len(time_s))
        return cls(half, int(inside.max()), max(1, round(_CHANGE_S / step)))

    @property
    def margin(self) -> int:
        """Number of frames before and after a range that its velocities depend on."""
        return self.neighbors + self.change


@dataclass(frozen=True, eq=False)
class Path:
    """Hold positions over time.

    Attributes:
        time_s: shape (frame,).
        xyz_m: shape (frame, 3).
        sd_m: shape (frame, 3): standard deviations.
        group: shape (frame,): only frames of the same group are used together, and none of group -1.
    """

    time_s: np.ndarray
    xyz_m: np.ndarray
    sd_m: np.ndarray
    group: np.ndarray


def path_velocity(path: Path, window: VelocityWindow, layer: LayerName) -> tuple[np.ndarray, np.ndarray]:
    """Return velocities and their standard deviations, each of shape (frame, 3), in m/s.

    Args:
        path: the path.
        window: frames to use.
        layer: layer of the points, which determines how errors persist and how much paths are smoothed.
    """
    n = len(path.time_s)
    if not window.neighbors or not n:
        return np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    at = np.arange(n)[:, None] + np.arange(-window.neighbors, window.neighbors + 1)
    inside = (at >= 0) & (at < n)
    at = at.clip(0, n - 1)
    apart = path.time_s[at] - path.time_s[:, None]
    used = inside & (np.abs(apart) <= window.half_s)
    used &= (path.group[at] == path.group[:, None]) & (path.group[:, None] >= 0)
    slopes = _slopes(apart / window.half_s, used)[..., None] / window.half_s
    velocity = (slopes * np.where(used[..., None], path.xyz_m[at], 0.0)).sum(axis=1)
    errors = slopes * np.where(used[..., None], path.sd_m[at], 0.0)
    between = _correlation(np.abs(apart[:, :, None] - apart[:, None]), layer)
    variance = np.einsum("fix,fij,fjx->fx", errors, between, errors)
    variance += (_SMOOTHED[layer] * _change(velocity, window.change)) ** 2
    return velocity, np.sqrt(variance)


def _change(velocity: np.ndarray, step: int) -> np.ndarray:
    """Return the second difference of the velocity, 0 where it is unknown, shape (frame, 3)."""
    change = np.zeros_like(velocity)
    if len(velocity) > 2 * step:
        change[step:-step] = velocity[2 * step :] - 2.0 * velocity[step:-step] + velocity[: -2 * step]
    return np.nan_to_num(change, nan=0.0)


def _slopes(apart: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Return the weights with which neighbors give the derivative of a parabola fitted to them.

    Args:
        apart: shape (frame, neighbor): times of the neighbors.
        used: shape (frame, neighbor): neighbors that count.

    Returns:
        Shape (frame, neighbor); NaN for frames with fewer than three neighbors, themselves included.
    """
    powers = np.where(used[..., None], apart[..., None] ** np.arange(_TERMS), 0.0)
    enough = used.sum(axis=1) >= _TERMS
    normal = np.einsum("fji,fjk->fik", powers, powers)
    normal[~enough] = np.eye(_TERMS)
    slopes = np.linalg.solve(normal, powers.transpose(0, 2, 1))[:, 1]
    slopes[~enough] = np.nan
    return slopes


def _correlation(lag_s: np.ndarray, layer: LayerName) -> np.ndarray:
    """Return the correlation between errors of one path at two times."""
    if layer == "measured":
        return np.where(lag_s == 0.0, 1.0, _LASTING * np.exp(-lag_s / _MEMORY_S[layer]))
    ratio = lag_s / _MEMORY_S[layer]
    return (1.0 + ratio) * np.exp(-ratio)
