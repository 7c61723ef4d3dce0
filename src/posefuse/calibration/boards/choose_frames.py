"""Which images of long videos are examined: periods of time in which the board shows new places and distances.

A quick look at images spread over the videos finds the board. Periods are then chosen greedily, so that pairs of
cameras see the board together, and the board has been everywhere in every image, near and far. Images in a period are
close enough in time to follow the motion of the board.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.boards.observations import CornerObservations

MAX_IMAGES = 1500
"""Videos with more images per camera are not examined whole."""

N_QUICK = 400
_PERIOD_S = 6.0
_RATE_HZ = 12.0
_GRID = (6, 4)
_SIZES = 3
_N_CELLS = _GRID[0] * _GRID[1] * _SIZES
_RUN = 4


@dataclass(frozen=True, eq=False)
class QuickLook:
    """Where one camera saw the board in images spread over its video.

    Attributes:
        time_s: shape (image,).
        corners_px: shape (image, corner, 2), NaN where not found.
        size_px: width and height of the images.
    """

    time_s: np.ndarray
    corners_px: np.ndarray
    size_px: tuple[int, int]

    def cells(self) -> np.ndarray:
        """Return the place and size of the board in each image as one number, shape (image,), -1 where not found."""
        found = np.isfinite(self.corners_px[:, :, 0])
        out = np.full(len(found), -1, dtype=np.int64)
        for k in np.flatnonzero(found.any(axis=1)):
            out[k] = _cell(self.corners_px[k, found[k]], self.size_px)
        return out


def _cell(corners_px: np.ndarray, size_px: tuple[int, int]) -> int:
    """Return the place and size of a board in an image as one number."""
    share = np.clip(corners_px.mean(axis=0) / np.array(size_px), 0.0, 1.0 - 1e-9)
    column, row = (share * np.array(_GRID)).astype(np.int64)
    extent = float(np.ptp(corners_px, axis=0).max()) / max(size_px)
    size = int(np.clip(np.log2(max(extent, 1e-6)) + _SIZES, 0, _SIZES - 1))
    return int((size * _GRID[1] + row) * _GRID[0] + column)


def quick_numbers(n_images: int) -> np.ndarray:
    """Return the numbers of the images of a video for the quick look, evenly spaced."""
    return np.unique(np.linspace(0, n_images - 1, min(N_QUICK, n_images)).round().astype(np.int64))


def choose_periods(looks: list[QuickLook]) -> np.ndarray:
    """Return the start times of the chosen periods, ascending, as many as the limit of images allows."""
    end_s = max(float(look.time_s[-1]) for look in looks if len(look.time_s))
    n_periods = max(int(end_s // _PERIOD_S) + 1, 1)
    seen = np.zeros((len(looks), n_periods, _N_CELLS), dtype=bool)
    for v, look in enumerate(looks):
        cells = look.cells()
        known = cells >= 0
        seen[v, (look.time_s[known] // _PERIOD_S).astype(np.int64), cells[known]] = True
    most = max(int((MAX_IMAGES - N_QUICK) / (_RATE_HZ * _PERIOD_S)), 1)
    return _greedy(seen, most) * _PERIOD_S


def choose_poses(corners: CornerObservations, sizes_px: list[tuple[int, int]], most: int) -> np.ndarray:
    """Return which poses of a board are adjusted if there are many, shape (pose,), bool.

    Runs of consecutive poses are chosen as periods are, because the motion of the board follows from neighbors.

    Args:
        corners: corners of the board.
        sizes_px: width and height of the images of each view.
        most: largest number of poses.
    """
    if corners.n_points <= most:
        return np.ones(corners.n_points, dtype=bool)
    run = np.arange(corners.n_points) // _RUN
    seen = np.zeros((len(sizes_px), int(run[-1]) + 1, _N_CELLS), dtype=bool)
    pair = corners.point * len(sizes_px) + corners.view
    starts = np.flatnonzero(np.diff(pair, prepend=-1))
    for start, stop in zip(starts, [*starts[1:], len(pair)], strict=True):
        view = corners.view[start]
        seen[view, run[corners.point[start]], _cell(corners.pixels[start:stop], sizes_px[view])] = True
    return np.isin(run, _greedy(seen, most // _RUN))


def _greedy(seen: np.ndarray, most: int) -> np.ndarray:
    """Return the indices of the periods that add most, ascending: rare pairs of cameras, then rare places.

    Args:
        seen: shape (view, period, place), bool: where each view sees the board.
        most: largest number of periods.
    """
    n_views, n_periods = seen.shape[:2]
    visible = np.asarray(seen.any(axis=2))
    pairs = (
        np.array([np.logical_and(visible[v], visible[u]) for v in range(n_views) for u in range(v)])
        .reshape(-1, n_periods)
        .T
    )
    places = seen.transpose(1, 0, 2).reshape(n_periods, -1)
    place_counts, pair_counts = np.zeros(places.shape[1]), np.zeros(pairs.shape[1])
    chosen: list[int] = []
    for _ in range(min(most, len(places))):
        gain = places @ (1.0 / (1.0 + place_counts) ** 2) + 4.0 * (pairs @ (1.0 / (1.0 + pair_counts) ** 2))
        gain[chosen] = 0.0
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        chosen.append(best)
        place_counts += places[best]
        pair_counts += pairs[best]
    return np.sort(np.array(chosen, dtype=np.int64))


def numbers_in_periods(time_s: np.ndarray, starts_s: np.ndarray) -> np.ndarray:
    """Return the numbers of the images of a video in some periods, at most twelve per second.

    Args:
        time_s: shape (image,): times of all images.
        starts_s: shape (period,), ascending.
    """
    period = np.searchsorted(starts_s, time_s, side="right") - 1
    inside = (period >= 0) & (time_s < starts_s[np.maximum(period, 0)] + _PERIOD_S)
    numbers = np.flatnonzero(inside)
    # One image per tick; ticks are counted over the whole video, so that all cameras keep the same instants.
    tick = np.floor(time_s[numbers] * _RATE_HZ + 1e-6).astype(np.int64)
    return numbers[np.unique(tick, return_index=True)[1]]
