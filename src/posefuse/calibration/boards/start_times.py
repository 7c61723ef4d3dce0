"""Coarse time offsets of videos that start up to some seconds apart, from the motion of the board.

Where two cameras show the same instant, the pose of one in the other, through the board, is always the same. For every
lag, the frames of two views that it pairs give such poses; the lag with the smallest spread is taken. It is accurate to
about a frame, from which the bundle adjustment estimates time offsets precisely.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.boards.pose_graph import ViewPoses

MAX_LAG_S = 10.0
_MAX_FRAMES = 60
_MIN_FRAMES = 8
_MIN_SHARE = 0.3
_CAP = 0.5
"""Largest deviation of a pose that counts, in radians and in shares of the distance of the board."""

_DECISIVE = 0.6
_FITS = 0.5 * _CAP


@dataclass(frozen=True, eq=False)
class TimedPoses:
    """Poses of the board in one camera.

    Attributes:
        time_s: shape (image,), ascending.
        poses: of the same images.
    """

    time_s: np.ndarray
    poses: ViewPoses


@dataclass(frozen=True)
class _Lag:
    """Delay of the second view's clock behind the first's at the same instant, and how many frames it pairs."""

    lag_s: float
    n_frames: int


def start_offsets_s(views: list[TimedPoses]) -> np.ndarray:
    """Return the time to add to the clock of each view, shape (view,), 0 for views that fit as they are.

    The view that shares most frames with others keeps its clock; the others are connected by a spanning tree.

    Args:
        views: poses of the board in each camera, at the times of its own clock.
    """
    n = len(views)
    lags = {(a, b): lag for a in range(n) for b in range(n) if a < b and (lag := _lag(views[a], views[b])) is not None}
    offsets = np.zeros(n)
    if not any(lag.lag_s for lag in lags.values()):
        return offsets
    strength = [sum(lag.n_frames for pair, lag in lags.items() if v in pair) for v in range(n)]
    placed = [int(np.argmax(strength))]
    while True:
        edges = [(lag.n_frames, pair) for pair, lag in lags.items() if (pair[0] in placed) != (pair[1] in placed)]
        if not edges:
            return offsets
        _, (a, b) = max(edges, key=lambda edge: (edge[0], [-v for v in edge[1]]))
        lag_s = lags[a, b].lag_s
        if a in placed:
            offsets[b] = offsets[a] - lag_s
            placed.append(b)
        else:
            offsets[a] = offsets[b] + lag_s
            placed.append(a)


def _lag(a: TimedPoses, b: TimedPoses) -> _Lag | None:
    """Return the lag of two views, 0 unless another one fits decisively better; None if no lag fits."""
    if min(len(a.time_s), len(b.time_s)) < _MIN_FRAMES:
        return None
    period_s = max(_period_s(a.time_s), _period_s(b.time_s))
    steps = np.arange(-int(MAX_LAG_S / period_s), int(MAX_LAG_S / period_s) + 1)
    pairs = [_paired(a.time_s, b.time_s, float(step) * period_s, 0.5 * period_s) for step in steps]
    counts = np.array([len(first) for first, _ in pairs])
    fewest = max(_MIN_FRAMES, _MIN_SHARE * counts.max())
    spreads = np.array(
        [
            _spread(a.poses, b.poses, *pair) if count >= fewest else np.inf
            for pair, count in zip(pairs, counts, strict=True)
        ]
    )
    best = int(np.argmin(spreads))
    if not spreads[best] < _FITS:
        return None
    zero = int(np.flatnonzero(steps == 0)[0])
    if not spreads[best] < _DECISIVE * spreads[zero]:
        best = zero
    return _Lag(float(steps[best]) * period_s, int(counts[best]))


def _period_s(time_s: np.ndarray) -> float:
    return max(float(np.median(np.diff(time_s))), 1e-3)


def _paired(a_s: np.ndarray, b_s: np.ndarray, lag_s: float, tolerance_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return indices of the images of two views that are at the same time if the second clock lags."""
    after = np.clip(np.searchsorted(b_s, a_s + lag_s), 1, len(b_s) - 1)
    nearest = after - (a_s + lag_s - b_s[after - 1] < b_s[after] - a_s - lag_s)
    close = np.flatnonzero(np.abs(b_s[nearest] - a_s - lag_s) <= tolerance_s * (1.0 + 1e-6))
    if len(close) > _MAX_FRAMES:
        close = close[np.linspace(0, len(close) - 1, _MAX_FRAMES).astype(np.int64)]
    return close, nearest[close]


def _spread(a: ViewPoses, b: ViewPoses, in_a: np.ndarray, in_b: np.ndarray) -> float:
    """Return the mean deviation of the relative poses of two cameras from their medoid."""
    rotations = b.rotations[in_b] @ a.rotations[in_a].transpose(0, 2, 1)
    translations = b.translations_m[in_b] - (rotations @ a.translations_m[in_a][:, :, None])[:, :, 0]
    reach = max(float(np.median(np.linalg.norm(a.translations_m, axis=1))), 1e-9)
    cosine = 0.5 * (np.einsum("nij,mij->nm", rotations, rotations) - 1.0)
    apart = np.linalg.norm(translations[:, None] - translations[None], axis=2) / reach
    return float(np.minimum(np.arccos(np.clip(cosine, -1.0, 1.0)) + apart, _CAP).mean(axis=1).min())
