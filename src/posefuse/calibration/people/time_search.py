"""Candidates for the time offset of two views, before their relative pose is known.

At the right offset, the image positions of moving keypoints in two distant views satisfy one linear equation (affine
epipolar geometry). Its residual over a grid of offsets has a minimum at the right one, and at others if motion is
periodic. Midpoints of left and right keypoints take part, which exchanged sides do not change.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from posefuse.calibration.people.bearings import Bearings
from posefuse.kernels.calibration.affine_agreement import affine_costs

GRID_S = 0.1
MAX_OFFSET_S = 2.0
_MAX_SAMPLES = 80
_MIN_SHARE = 0.4
_MIN_DEPTH = 0.05
_MISSING_COST = 0.5
_PRIOR_COST = 0.02
_SWEEPS = 6
_TWO, _BEYOND = 2, 3
"""Steps beyond the largest offset at which costs are compared: a cost that falls there is no minimum."""
_MOST_STARTS = {2: 4, 3: 3}
"""Number of time offsets from which rigs of few views are assembled: their pairs confirm each other little."""


def offset_candidates(
    a: Bearings, b: Bearings, people: tuple[tuple[int, int], ...], max_offset_s: float, rate: float, n: int
) -> list[float]:
    """Return the most plausible offsets of the second view, best first; 0 is always one of them.

    Args:
        a: first view.
        b: second view.
        people: corresponding persons of the two views.
        max_offset_s: bound of the offsets.
        rate: seconds of the first view per second of the second.
        n: largest number of candidates.
    """
    half = round(max_offset_s / GRID_S)
    grid = GRID_S * np.arange(-half - _BEYOND, half + _BEYOND + 1.0)
    costs = affine_curve(a, b, people, grid, rate)
    if not np.isfinite(costs).any():
        return [0.0]
    padded = np.pad(np.where(np.isfinite(costs), costs, np.inf), 2, constant_values=np.inf)
    lowest = np.min([padded[k : k + len(costs)] for k in range(5)], axis=0)
    minima = [k for k in np.argsort(costs, kind="stable") if np.isfinite(costs[k]) and costs[k] <= lowest[k]]
    minima = [k for k in minima if _BEYOND <= k <= 2 * half + _BEYOND]
    chosen = [float(grid[k]) for k in minima[:n]]
    if not any(abs(offset) < GRID_S for offset in chosen):
        chosen = [*chosen[: max(n - 1, 1)], 0.0]
    return chosen


def rig_offsets(
    views: Sequence[Bearings],
    people: Sequence[Sequence[int]],
    rate: np.ndarray,
    max_offset_s: float = MAX_OFFSET_S,
) -> list[np.ndarray]:
    """Return approximate time offsets of all views relative to the first, shape (view,), the most plausible first.

    Pairs of views agree best at them together; the first guesses are synchronized views and the best offsets to each
    view. Two or three views have several.

    Args:
        views: directions of all views.
        people: index of each person in every view, -1 where a view does not observe it.
        rate: shape (view,): true seconds per second of the timestamps.
        max_offset_s: bound of the offset between two views.
    """
    n = len(views)
    if n == _TWO:
        shared = tuple((person[0], person[1]) for person in people if min(person) >= 0)
        found = offset_candidates(
            views[0], views[1], shared, max_offset_s, float(rate[1] / rate[0]), _MOST_STARTS[_TWO]
        )
        return [np.array([0.0, rate[0] * offset]) for offset in found]
    half = round(max_offset_s / GRID_S)
    grid = GRID_S * np.arange(-half, half + 1)
    curves = np.zeros((n, n, len(grid)))
    for a, b in combinations(range(n), 2):
        shared = tuple((person[a], person[b]) for person in people if person[a] >= 0 and person[b] >= 0)
        if not shared:
            continue
        # In the time of the first view of the pair, which runs at its own rate.
        curve = affine_curve(views[a], views[b], shared, grid / rate[a], float(rate[b] / rate[a]))
        if np.isfinite(curve).any():
            curve = np.where(np.isfinite(curve), curve - np.nanmedian(curve), _MISSING_COST)
            curves[a, b], curves[b, a] = curve, curve[::-1]
    starts = [np.zeros(n, dtype=np.int64)]
    starts += [
        np.array([0 if v == root else int(curves[root, v].argmin()) - half for v in range(n)]) for root in range(n)
    ]
    prior = _PRIOR_COST * (MAX_OFFSET_S / max(max_offset_s, MAX_OFFSET_S)) ** 2
    descents = sorted((_descend(curves, start - start[0], half, prior) for start in starts), key=lambda pair: pair[0])
    distinct = {offsets.tobytes(): GRID_S * offsets for _, offsets in descents}
    return list(distinct.values())[: _MOST_STARTS.get(n, 1)]


def _descend(curves: np.ndarray, offsets: np.ndarray, half: int, prior: float) -> tuple[float, np.ndarray]:
    """Improve one view's offset at a time; return the cost and the offsets in steps of the grid, the first at 0.

    Args:
        curves: shape (view, view, offset): cost of every offset of every pair of views.
        offsets: shape (view,): first guess, in steps.
        half: largest offset of a pair, in steps.
        prior: cost of the square of an offset in seconds.
    """
    n = len(offsets)
    steps = np.arange(-half, half + 1)
    offsets = offsets.copy()

    def costs(v: int, candidates: np.ndarray) -> np.ndarray:
        total = prior * (GRID_S * candidates) ** 2
        for u in range(n):
            if u != v:
                apart = candidates - offsets[u]
                inside = np.abs(apart) <= half
                total = total + np.where(inside, curves[u, v, np.clip(apart + half, 0, 2 * half)], _MISSING_COST)
        return total

    for _ in range(_SWEEPS):
        before = offsets.copy()
        for v in range(1, n):
            offsets[v] = steps[np.argmin(costs(v, steps))]
        if (offsets == before).all():
            break
    return sum(float(costs(v, offsets[v : v + 1])[0]) for v in range(n)), offsets


def affine_curve(
    a: Bearings, b: Bearings, people: tuple[tuple[int, int], ...], grid_s: np.ndarray, rate: float
) -> np.ndarray:
    """Return the mean robust cost of an affine epipolar geometry, shape (offset,); NaN where few points are shared.

    Args:
        a: first view.
        b: second view.
        people: corresponding persons of the two views.
        grid_s: shape (offset,): time of the first view minus ``rate`` times that of the second.
        rate: seconds of the first view per second of the second.
    """
    samples = a.sample_times(_MAX_SAMPLES)
    at_a, variance_a, at_b, variance_b = [], [], [], []
    for person_a, person_b in people:
        rays, _, sigma = a.at(samples, person_a)
        points, variance = _planar_points(rays, sigma, a.axes(person_a), a.mirror)
        at_a.append(points.reshape(-1, 2))
        variance_a.append(variance.ravel())
        times = (samples - grid_s[:, None]) / rate
        rays, _, sigma = b.at(times.ravel(), person_b)
        points, variance = _planar_points(rays, sigma, b.axes(person_b), b.mirror)
        at_b.append(points.reshape(len(grid_s), -1, 2))
        variance_b.append(variance.reshape(len(grid_s), -1))
    costs, counts = np.empty(len(grid_s)), np.empty(len(grid_s), dtype=np.int64)
    affine_costs(
        np.concatenate(at_a),
        np.concatenate(variance_a),
        np.concatenate(at_b, axis=1),
        np.concatenate(variance_b, axis=1),
        costs,
        counts,
    )
    return np.where(counts >= _MIN_SHARE * counts.max(), costs, np.nan)


def _planar_points(
    rays: np.ndarray, sigma: np.ndarray, axes: np.ndarray, mirror: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return keypoints and midpoints of left and right in the image plane of a rotated view, and their variances.

    Shapes (sample, point, 2) and (sample, point).
    """
    depth = rays @ axes[2]
    depth = np.where(depth > _MIN_DEPTH, depth, np.nan)
    plane = np.stack([rays @ axes[0], rays @ axes[1]], axis=-1) / depth[..., None]
    left = np.flatnonzero(np.arange(len(mirror)) < mirror)
    right = mirror[left]
    points = np.concatenate([plane, 0.5 * (plane[:, left] + plane[:, right])], axis=1)
    variance = sigma**2
    return points, np.concatenate([variance, 0.5 * (variance[:, left] + variance[:, right])], axis=1)
