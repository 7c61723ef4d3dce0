"""Estimate the heights of the floor and of other levels, such as stairs, from resting feet."""

from dataclasses import dataclass

import numpy as np

from posefuse.biomechanics.foot_paths import HEEL, TOES, FootPaths

_TILT_SD = np.tan(np.radians(2.0))
"""Standard deviation of the slope of the floor: the up direction is known to about this angle."""
_HEIGHT_SD_M = (0.01, 0.04)
_MERGE_M = 0.08
"""Levels closer than this are one."""
_MIN_EXTENSION = 0.85
"""Smallest extension of a leg that stands on a level, as a share of its usual largest extension."""


@dataclass(frozen=True, eq=False)
class Levels:
    """Levels on which feet rest.

    Attributes:
        heights_m: shape (level,): heights of the heel of a resting foot at the origin, in increasing order.
        slope: shape (2,): slope along the horizontal axes.
        toe_above_heel_m: height of the toes above the heel in a resting foot.
        sd_m: spread of the heights of resting feet.
    """

    heights_m: np.ndarray
    slope: np.ndarray
    toe_above_heel_m: float
    sd_m: float

    @classmethod
    def none(cls) -> "Levels":
        """Return no levels."""
        return cls(np.empty(0), np.zeros(2), 0.0, _HEIGHT_SD_M[1])

    def nearest_height(self, feet_m: np.ndarray) -> np.ndarray:
        """Return heights above the nearest level, shape (frame, side, part), negative below it.

        Args:
            feet_m: shape (frame, side, part, 3).
        """
        height = feet_m[..., 2] - feet_m[..., :2] @ self.slope
        height[..., TOES] -= self.toe_above_heel_m
        if not self.heights_m.size:
            return height
        apart = height[..., None] - self.heights_m
        nearest = np.abs(np.where(np.isfinite(apart), apart, 0.0)).argmin(axis=-1)
        return np.take_along_axis(apart, nearest[..., None], axis=-1)[..., 0]


def find_levels(paths: FootPaths, resting: np.ndarray) -> Levels:
    """Estimate levels from the probability that points rest.

    A level is the lowest one, or one on which a leg is nearly extended: a foot held in the air does not rest on one.

    Args:
        paths: paths of the person.
        resting: shape (frame, side, part): probability that a point rests.
    """
    known = np.isfinite(paths.feet_m[..., 0])
    flat = known.all(axis=2) & (resting > 0.8).all(axis=2)
    if flat.sum() < 5:
        flat = known.all(axis=2) & (resting > 0.5).any(axis=2)
    if flat.sum() < 5:
        return Levels.none()
    frames, sides = np.nonzero(flat)
    heels, toes = paths.feet_m[frames, sides, HEEL], paths.feet_m[frames, sides, TOES]
    above = float(np.median(toes[:, 2] - heels[:, 2]))
    points = 0.5 * (heels + toes)
    heights = points[:, 2] - 0.5 * above
    center = points[:, :2].mean(axis=0)
    slope, offsets = np.zeros(2), heights
    for _ in range(3):
        groups = _clusters(offsets)
        slope = _slope(points[:, :2] - center, heights, groups)
        offsets = heights - (points[:, :2] - center) @ slope
    groups = _clusters(offsets)
    extension = np.linalg.norm(paths.hips_m[frames, sides] - heels, axis=1)
    usual = np.nanquantile(extension, 0.95) if np.isfinite(extension).any() else np.nan
    at_origin = -(center @ slope)
    found = []
    for group in range(groups.max() + 1):
        inside = groups == group
        stands = not np.isfinite(usual) or np.nanmax(extension[inside], initial=0.0) >= _MIN_EXTENSION * usual
        if group == 0 or (stands and inside.sum() >= 3):
            found.append(float(np.median(offsets[inside])) + at_origin)
    spread = np.concatenate([offsets[groups == g] - np.median(offsets[groups == g]) for g in range(groups.max() + 1)])
    sd = float(np.clip(1.4826 * np.median(np.abs(spread)), *_HEIGHT_SD_M))
    return Levels(np.array(found), slope, above, sd)


def _clusters(heights_m: np.ndarray) -> np.ndarray:
    """Return the cluster of every height, numbered upward: peaks of their density, at least 8 cm apart."""
    edges = np.arange(heights_m.min() - 0.1, heights_m.max() + 0.11, 0.01)
    counts = np.histogram(heights_m, edges)[0].astype(np.float64)
    kernel = np.exp(-0.5 * np.square(np.arange(-6, 7) / 2.0))
    density = np.convolve(counts, kernel, mode="same")
    middles, peaks = 0.5 * (edges[1:] + edges[:-1]), []
    for i in np.argsort(-density, kind="stable"):
        if density[i] < 0.02 * density.max():
            break
        if all(abs(middles[i] - peak) > _MERGE_M for peak in peaks):
            peaks.append(float(middles[i]))
    centers = np.sort(np.array(peaks))
    # A peak between others may be the nearest of none.
    return np.unique(np.abs(heights_m[:, None] - centers).argmin(axis=1), return_inverse=True)[1]


def _slope(places_m: np.ndarray, heights_m: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Return the common slope of all levels, shape (2,), with the prior of a level floor."""
    apart, offset = places_m.copy(), heights_m.copy()
    for group in range(groups.max() + 1):
        inside = groups == group
        apart[inside] -= apart[inside].mean(axis=0)
        offset[inside] -= offset[inside].mean()
    # Neighboring frames repeat each other: the information of one stance per half second or so.
    variance = _HEIGHT_SD_M[1] ** 2 * max(1.0, len(offset) / 20.0)
    return np.linalg.solve(apart.T @ apart + variance / _TILT_SD**2 * np.eye(2), apart.T @ offset)
