"""Check the scale of the world by the lengths of bones."""

from collections.abc import Sequence

import numpy as np

from posefuse.skeleton.skeletons import Skeleton

_UNITS = {"mm": 1000.0, "cm": 100.0, "m": 1.0}
_MIN_POINTS = 10


def scale_finding(points_m: Sequence[np.ndarray], skeleton: Skeleton, meters_per_unit: float) -> str | None:
    """Return a sentence if most bones have implausible lengths, else None.

    Args:
        points_m: arrays of shape (..., keypoint, 3).
        skeleton: its ``plausible_m`` gives the range of each length; without it, the result is None.
        meters_per_unit: factor by which the lengths of the calibration were multiplied.
    """
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
    factor = float(np.median(ratios))
    unit = next((unit for unit, per in _UNITS.items() if 0.4 < factor / (meters_per_unit * per) < 2.5), None)
    remedy = (
        f"The calibration is probably in {unit}: add --length-unit {unit}."
        if unit
        else "Check the length unit of the calibration (--length-unit) and the size of its calibration board."
    )
    return f"The scale is wrong for this skeleton: {examples[0]}. {remedy}"
