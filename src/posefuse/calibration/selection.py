"""Select the points to adjust to, and hold out frames for validation."""

import numpy as np

from posefuse.calibration.point_observations import PointObservations

_BLOCKS = 25
_FOLDS = 5
_HELD_OUT_FOLD = 2
_CELLS_PER_AXIS = 5


def held_out_frames(n_frames: int) -> np.ndarray:
    """Return the frames held out for validation: a fifth of the recording, in blocks spread over it.

    Errors of neighboring frames are correlated, so single frames would be no independent validation.

    Returns:
        Shape (frame,), bool.
    """
    blocks = np.arange(n_frames) * min(_BLOCKS, n_frames) // max(n_frames, 1)
    return blocks % _FOLDS == _HELD_OUT_FOLD


def select_spread_points(observations: PointObservations, n_views: int, max_points: int) -> np.ndarray:
    """Select points that are spread over the volume, the groups of views that observe them, and time.

    Points are sorted into cells of the volume and groups of views. Small cells are used completely; large ones
    contribute equally many points, evenly spread in time.

    Args:
        observations: of the points.
        n_views: number of views.
        max_points: largest number of points to select.

    Returns:
        Shape (point,), bool.
    """
    n = observations.n_points
    if n <= max_points:
        return np.ones(n, dtype=bool)
    low, high = np.percentile(observations.points_m, [2, 98], axis=0)
    position = (observations.points_m - low) / np.maximum(high - low, 1e-12)
    cells = np.clip((position * _CELLS_PER_AXIS).astype(int), 0, _CELLS_PER_AXIS - 1)
    seen = np.zeros((n, n_views), dtype=np.int64)
    seen[observations.point, observations.view] = 1
    _, group = np.unique(np.concatenate([cells, seen], axis=1), axis=0, return_inverse=True)
    order = np.lexsort((observations.keypoint, observations.frame, group.ravel()))
    sizes = np.bincount(group.ravel())
    starts = np.cumsum(sizes) - sizes
    chosen = np.zeros(n, dtype=bool)
    quota = _max_per_group(sizes, max_points)
    for start, size in zip(starts, sizes, strict=True):
        n_taken = min(size, quota)
        chosen[order[start + ((np.arange(n_taken) + 0.5) * size / max(n_taken, 1)).astype(int)]] = True
    return chosen


def _max_per_group(sizes: np.ndarray, max_points: int) -> int:
    """Return the largest number of points per group, at least 1, with no more than ``max_points`` in total."""
    low, high = 1, int(sizes.max())
    while low < high:
        middle = (low + high + 1) // 2
        if np.minimum(sizes, middle).sum() <= max_points:
            low = middle
        else:
            high = middle - 1
    return low
