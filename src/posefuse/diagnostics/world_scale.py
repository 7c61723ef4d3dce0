"""Is the world in metres? Bones say so."""

from collections.abc import Sequence

import numpy as np

from posefuse.skeleton.skeletons import Skeleton

_UNITS = {"mm": 1000.0, "cm": 100.0, "m": 1.0}


def scale_finding(points_m: Sequence[np.ndarray], skeleton: Skeleton, metres_per_unit: float) -> str | None:
    """A sentence if bones have lengths no body has, else None.

    Args:
        points_m: arrays of shape (..., keypoint, 3).
        skeleton: whose ``plausible_m`` says what lengths a body can have; without it, nothing is said.
        metres_per_unit: what the calibration's lengths were multiplied by.
    """
    ratios, examples = [], []
    for a, b, low, high in skeleton.plausible_m:
        i, j = skeleton.index(a), skeleton.index(b)
        lengths = np.concatenate([np.linalg.norm(p[..., i, :] - p[..., j, :], axis=-1).ravel() for p in points_m])
        lengths = lengths[np.isfinite(lengths)]
        if len(lengths) < 10:
            continue
        middle = float(np.median(lengths))
        ratios.append(middle / np.sqrt(low * high))
        if not low <= middle <= high:
            examples.append(f"{a} to {b} measures {middle:.3g} m, a body's {low:g} to {high:g} m")
    if not examples or len(examples) < 0.5 * len(ratios):
        return None
    factor = float(np.median(ratios))
    fitting = next((unit for unit, per in _UNITS.items() if 0.4 < factor / (metres_per_unit * per) < 2.5), None)
    remedy = (
        f"The calibration's lengths are probably in {fitting}: add --length-unit {fitting}."
        if fitting
        else "Check the calibration's unit of length (--length-unit) and the size of the board it was made with."
    )
    return f"The scale is wrong for this skeleton: {examples[0]}. {remedy}"
