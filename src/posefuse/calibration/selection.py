"""Which of the points a recording has are enough, and which are kept back to judge the result by."""

import numpy as np

from posefuse.calibration.sightings import Sightings

_BLOCKS = 25
_EVERY = 5
_HELD = 2
_CELLS = 5


def held_out(n_frames: int) -> np.ndarray:
    """Which frames are kept back: a fifth of the recording, in blocks spread over it, whole frames each.

    Neighbouring frames show nearly the same, errors and all: single frames would be no judges.

    Returns:
        Shape (frame,), bool.
    """
    blocks = np.arange(n_frames) * min(_BLOCKS, n_frames) // max(n_frames, 1)
    return blocks % _EVERY == _HELD


def spread_out(sightings: Sightings, n_views: int, most: int) -> np.ndarray:
    """Choose points that spread over the volume, the groups of views that see them, and time.

    Points are sorted into cells of the volume and groups of views; small cells are taken whole, of large ones as many
    points as the rest leaves room for, evenly spread in time.

    Returns:
        Shape (point,), bool.
    """
    n = sightings.n_points
    if n <= most:
        return np.ones(n, dtype=bool)
    low, high = np.percentile(sightings.points_m, [2, 98], axis=0)
    place = (sightings.points_m - low) / np.maximum(high - low, 1e-12)
    cells = np.clip((place * _CELLS).astype(int), 0, _CELLS - 1)
    seen = np.zeros((n, n_views), dtype=np.int64)
    seen[sightings.point, sightings.view] = 1
    _, group = np.unique(np.concatenate([cells, seen], axis=1), axis=0, return_inverse=True)
    order = np.lexsort((sightings.keypoint, sightings.frame, group.ravel()))
    sizes = np.bincount(group.ravel())
    starts = np.cumsum(sizes) - sizes
    chosen = np.zeros(n, dtype=bool)
    share = _level(sizes, most)
    for start, size in zip(starts, sizes, strict=True):
        taken = min(size, share)
        chosen[order[start + ((np.arange(taken) + 0.5) * size / max(taken, 1)).astype(int)]] = True
    return chosen


def _level(sizes: np.ndarray, most: int) -> int:
    """The most that each group may give for all together to give no more than ``most``; one at least."""
    low, high = 1, int(sizes.max())
    while low < high:
        middle = (low + high + 1) // 2
        if np.minimum(sizes, middle).sum() <= most:
            low = middle
        else:
            high = middle - 1
    return low
