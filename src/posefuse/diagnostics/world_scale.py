"""Check the scale of the world by the lengths of bones."""

from collections.abc import Sequence

import numpy as np

from posefuse.skeleton.skeletons import Skeleton

_UNITS = {"mm": 1000.0, "cm": 100.0, "m": 1.0}
_MIN_POINTS = 10
_MAX_SIZE_RATIO = 4.0
"""Largest ratio of a body's extent to the size that its skeleton states; units of length differ by ten at least."""


def scale_finding(points_m: Sequence[np.ndarray], skeleton: Skeleton, meters_per_unit: float) -> str | None:
    """Return a sentence if most bones have implausible lengths, else None.

    Args:
        points_m: arrays of shape (..., keypoint, 3).
        skeleton: its ``plausible_m`` gives the range of each length; without it, the size of its kinematic tree must
            agree with the largest distance between keypoints. Without either, the result is None.
        meters_per_unit: factor by which the lengths of the calibration were multiplied.
    """
    if not skeleton.plausible_m:
        return _size_finding(points_m, skeleton, meters_per_unit)
    ratios, examples = [], []
    for a, b, low, high in skeleton.plausible_m:
        i, j = skeleton.index(a), skeleton.index(b)
        lengths = np.concatenate([np.linalg.norm(p[..., i, :] - p[..., j, :], axis=-1).ravel() for p in points_m])
        lengths = lengths[np.isfinite(lengths)]
        if len(lengths) < _MIN_POINTS:
            continue
        median = float(np.median(lengths))
        ratios.append(median / np.sqrt(low * high))
        if not low <= median <= high:
            examples.append(f"the distance from {a} to {b} is {median:.3g} m, expected {low:g} to {high:g} m")
    if not examples or len(examples) < 0.5 * len(ratios):
        return None
    return f"The scale is wrong for this skeleton: {examples[0]}. {_remedy(float(np.median(ratios)), meters_per_unit)}"


def _size_finding(points_m: Sequence[np.ndarray], skeleton: Skeleton, meters_per_unit: float) -> str | None:
    """Return a sentence if bodies are far larger or smaller than the kinematic tree says, else None."""
    if skeleton.tree is None:
        return None
    extents = np.concatenate([_extents(points) for points in points_m])
    extents = extents[np.isfinite(extents)]
    if len(extents) < _MIN_POINTS:
        return None
    extent, size = float(np.median(extents)), skeleton.tree.size_m
    if size / _MAX_SIZE_RATIO <= extent <= size * _MAX_SIZE_RATIO:
        return None
    return (
        f"The scale is wrong for this skeleton: bodies measure {extent:.3g} m, and the skeleton {skeleton.name!r} "
        f"states a size of {size:.3g} m. {_remedy(extent / size, meters_per_unit)}"
    )


def _extents(points: np.ndarray) -> np.ndarray:
    """Return the diagonal of the box around each body with most keypoints, shape (body,); NaN for others."""
    bodies = points.reshape(-1, *points.shape[-2:])
    seen = np.isfinite(bodies[..., 0])
    high, low = (
        edge(np.where(seen[..., None], bodies, -sign * np.inf), axis=1) for edge, sign in ((np.max, 1), (np.min, -1))
    )
    with np.errstate(invalid="ignore"):
        extents = np.linalg.norm(high - low, axis=-1)
    return np.where(2 * seen.sum(axis=1) > seen.shape[1], extents, np.nan)


def _remedy(factor: float, meters_per_unit: float) -> str:
    """Return what to do about lengths that are too large by a factor."""
    unit = next((unit for unit, per in _UNITS.items() if 0.4 < factor / (meters_per_unit * per) < 2.5), None)
    if unit:
        return f"The calibration is probably in {unit}: add `length_unit={unit!r}`."
    return "Check the length unit of the calibration (`length_unit`) and the size of its calibration board."
