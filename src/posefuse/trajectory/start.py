"""Where the solve begins: measured points that fit their neighbours in time, and what lies between them."""

import numpy as np
from scipy.ndimage import median_filter

from posefuse.trajectory.observed import Observed

_WINDOW_S = 0.2
_FEWEST = 5
_FAR = 6.0
"""In median deviations from the median of the neighbours: no measured point of a smooth path is so far off."""


def begin(observed: Observed) -> tuple[np.ndarray, np.ndarray]:
    """Paths to begin with, shape (keypoint, frame, 3), and the weights of their views, (keypoint, frame, view)."""
    paths = fill(observed.points_m, observed.time_s)
    window = max(_FEWEST, 2 * round(0.5 * _WINDOW_S / observed.step_s) + 1)
    middle = median_filter(paths, size=(1, window, 1), mode="mirror")
    off = np.linalg.norm(observed.points_m - middle, axis=-1)
    there = np.isfinite(off)
    usual = np.array(
        [np.median(own[own_there]) if own_there.any() else 0.0 for own, own_there in zip(off, there, strict=True)]
    )
    fits = there & (off <= _FAR * usual[:, None])
    paths = fill(np.where(fits[..., None], observed.points_m, np.nan), observed.time_s)
    return paths, np.where(observed.agreed & fits[..., None] & np.isfinite(observed.sigma_px), 1.0, 0.0)


def fill(points_m: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Points (keypoint, frame, 3) with what is missing put on the line between neighbours, or at the nearest one.

    A keypoint that is nowhere known begins in the middle of the others.
    """
    out = points_m.copy()
    known = np.asarray(np.isfinite(points_m).all(axis=-1))
    middle = np.median(points_m[known], axis=0) if known.any() else np.zeros(3)
    for k, there in enumerate(known):
        if not there.any():
            out[k] = middle
        elif not there.all():
            for i in range(3):
                out[k, :, i] = np.interp(time_s, time_s[there], points_m[k, there, i])
    return out
