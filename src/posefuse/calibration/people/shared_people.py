"""Find which tracks of two views are the same people, and the relative pose of the views that explains all of them.

Before the pose is known, the motion of two tracks of one person satisfies an affine epipolar geometry at the right time
offset and at no other (:mod:`.time_search`); this contrast votes for pairs of tracks and for the offset. A relative
pose estimated from the voted pairs then accepts or rejects all pairs, by their epipolar errors and by the size that the
person has in both views, and is estimated again from the accepted ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.people.bearings import Bearings
from posefuse.calibration.people.pairs import PairGeometry, relate_pair
from posefuse.calibration.people.time_search import GRID_S, affine_curve
from posefuse.kernels.calibration import people_agreement as agreement

MAX_COST = 1.4
"""Largest mean robust cost of a match; right ones have about 1.0 if the noise is twice the nominal one."""
CLEARLY_EXPLAINED = 0.7
"""Share of the people seen at once that a geometry matches, from which no other geometry is tried."""
MAX_LOG_SIZE = 0.4
_MAX_BEHIND = 0.3
_MIN_POINTS = 12
_MAX_SAMPLES = 200
_MAX_CURVES = 36
_MAX_OFFSETS = 6
_MAX_IMPROVED = 3
_MAX_REFINED_PAIRS = 8
_MAX_ROUNDS = 3
_MIN_OVERLAP_S = 0.5
_SHARED_SAMPLES = 2

Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class SharedPeople:
    """Hold what two views have in common.

    Attributes:
        geometry: relative pose and time offset.
        matches: corresponding tracks: index in the first and in the second view, the surest first.
        support: shape (match,): how much more probable each match is than an outlier, summed over its points.
        explained: share of the people seen at once by both views that are matched.
        different: pairs of tracks that the geometry excludes.
    """

    geometry: PairGeometry
    matches: tuple[Pair, ...]
    support: np.ndarray
    explained: float
    different: tuple[Pair, ...]


@dataclass(frozen=True, eq=False)
class Agreement:
    """Hold how well all pairs of tracks of two views agree with a geometry.

    Attributes:
        cost: shape (track of a, track of b): mean robust cost, inf where too few points are shared.
        points: the same: number of points.
        log_size: the same: logarithm of the ratio of a person's sizes according to the two views.
        behind: the same: share of the points behind a camera.
        together_a: shape (track, track): number of samples in which both tracks of the first view are seen.
        together_b: the same for the second view.
        people: number of samples and people who could be matched.
        samples: shape (track of a, track of b): number of samples with both tracks.
    """

    cost: np.ndarray
    points: np.ndarray
    log_size: np.ndarray
    behind: np.ndarray
    together_a: np.ndarray
    together_b: np.ndarray
    people: int
    samples: np.ndarray

    @property
    def support(self) -> np.ndarray:
        """Shape (track of a, track of b): summed advantage over the largest cost; 0 where a match is excluded."""
        gain = np.where(np.isfinite(self.cost), MAX_COST - self.cost, 0.0) * self.points
        allowed = (np.abs(self.log_size) < MAX_LOG_SIZE) & (self.behind < _MAX_BEHIND)
        return np.where(allowed, np.maximum(gain, 0.0), 0.0)

    @property
    def excluded(self) -> np.ndarray:
        """Shape (track of a, track of b): whether the two tracks are certainly different people."""
        return np.isfinite(self.cost) & ((self.cost > 1.5 * MAX_COST) | (np.abs(self.log_size) > 2.0 * MAX_LOG_SIZE))


def shared_people(a: Bearings, b: Bearings, *, max_offset_s: float, seed: int = 0) -> SharedPeople | None:
    """Return the matches of the tracks of two views and their relative pose, or None if no pose explains any.

    Args:
        a: first view.
        b: second view.
        max_offset_s: bound of the time offset; 0 if the views are synchronized.
        seed: random seed.
    """
    found: list[SharedPeople] = []
    for offset_s, pairs in _voted(a, b, max_offset_s):
        for chosen in _seeds(pairs):
            start = _related(a, b, chosen, (offset_s,) if max_offset_s > 0.0 else (), seed)
            if start is None:
                continue
            found.append(start)
            if len(start.matches) > 1 and start.explained > CLEARLY_EXPLAINED:
                return _improved(a, b, start, seed)
    found.sort(key=lambda each: -float(each.support.sum()))
    improved = [_improved(a, b, start, seed) for start in found[:_MAX_IMPROVED]]
    return max(improved, key=lambda each: float(each.support.sum()), default=None)


def _seeds(pairs: Sequence[Pair]) -> list[tuple[Pair, ...]]:
    """Return sets of the pairs that voted for an offset: many, which may contain wrong ones, and single ones."""
    sets = [tuple(pairs[:8]), tuple(pairs[:3]), tuple(pairs[:1]), tuple(pairs[1:2])]
    return [each for each in dict.fromkeys(sets) if each]


def agreement_of(a: Bearings, b: Bearings, geometry: PairGeometry) -> Agreement:
    """Compare all tracks of two views under a geometry."""
    times = a.sample_times(_MAX_SAMPLES)
    inside = (times - geometry.offset_s) / geometry.rate
    rays_a, variance_a = _rays_at(a, times)
    rays_b, variance_b = _rays_at(b, inside)
    results = np.zeros((len(times), a.n_people, b.n_people, agreement.N_RESULTS))
    agreement.people_agreement(
        geometry.rotation, geometry.translation, rays_a, rays_b, variance_a, variance_b, a.mirror, results
    )
    points = results[..., agreement.POINTS].sum(axis=0)
    enough = points >= _MIN_POINTS
    cost = np.where(enough, results[..., agreement.COST].sum(axis=0) / np.maximum(points, 1.0), np.inf)
    behind = results[..., agreement.BEHIND].sum(axis=0) / np.maximum(points, 1.0)
    seen_a, seen_b = _seen(rays_a), _seen(rays_b)
    return Agreement(
        cost,
        points,
        _log_size(results, rays_a, rays_b),
        behind,
        _together(seen_a, seen_a),
        _together(seen_b, seen_b),
        int(np.minimum(seen_a.sum(axis=1), seen_b.sum(axis=1)).sum()),
        _together(seen_a, seen_b),
    )


def _rays_at(view: Bearings, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rays, shape (sample, person, keypoint, 3), and their variances."""
    found = [view.at(time_s, person) for person in range(view.n_people)]
    rays = np.ascontiguousarray(np.stack([rays for rays, _, _ in found], axis=1))
    return rays, np.ascontiguousarray(np.stack([sigma for _, _, sigma in found], axis=1) ** 2)


def _seen(rays: np.ndarray) -> np.ndarray:
    """Return whether a person is seen, shape (sample, person)."""
    return np.asarray(np.isfinite(rays[..., 0]).any(axis=2))


def _together(seen_a: np.ndarray, seen_b: np.ndarray) -> np.ndarray:
    """Return the number of samples in which both tracks are seen, shape (track, track)."""
    return seen_a.T.astype(float) @ seen_b.astype(float)


def _log_size(results: np.ndarray, rays_a: np.ndarray, rays_b: np.ndarray) -> np.ndarray:
    """Return the median logarithm of the ratio of sizes, shape (track of a, track of b); 0 without any."""
    ratio = log_sizes(results, rays_a, rays_b)
    out = np.zeros(ratio.shape[1:])
    known = np.isfinite(ratio).any(axis=0)
    out[known] = np.nanmedian(ratio[:, known], axis=0)
    return out


def log_sizes(results: np.ndarray, rays_a: np.ndarray, rays_b: np.ndarray) -> np.ndarray:
    """Return the logarithm of the ratio of a person's sizes according to two views.

    Args:
        results: shape (sample, person of a, person of b, N_RESULTS): of the kernel.
        rays_a: shape (sample, person, keypoint, 3).
        rays_b: the same of the second view.

    Returns:
        Shape (sample, person of a, person of b), NaN where unknown.
    """
    with np.errstate(all="ignore"):
        size_a = results[..., agreement.DEPTH_A] * _spread(rays_a)[:, :, None]
        size_b = results[..., agreement.DEPTH_B] * _spread(rays_b)[:, None, :]
        ratio = np.log(size_a) - np.log(size_b)
    ratio[~np.isfinite(ratio)] = np.nan
    return ratio


def _spread(rays: np.ndarray) -> np.ndarray:
    """Return the root mean square distance of the rays of a person from their mean, shape (sample, person)."""
    seen = np.isfinite(rays[..., 0])
    count = np.maximum(seen.sum(axis=2), 1)[..., None]
    filled = np.where(seen[..., None], rays, 0.0)
    mean = filled.sum(axis=2) / count
    squared = np.where(seen, ((filled - mean[:, :, None]) ** 2).sum(axis=-1), 0.0)
    spread = np.sqrt(squared.sum(axis=2) / count[..., 0])
    return np.where(seen.sum(axis=2) >= 2, spread, np.nan)


def exclusive_matches(support: np.ndarray, together_a: np.ndarray, together_b: np.ndarray) -> list[Pair]:
    """Return the pairs with the most support, so that no track has two partners at the same time."""
    chosen: list[Pair] = []
    order = np.argsort(-support, axis=None, kind="stable")
    for flat in order:
        i, j = (int(k) for k in np.unravel_index(flat, support.shape))
        if support[i, j] <= 0.0:
            break
        of_i = any(k == i and together_b[j, other] > _SHARED_SAMPLES for k, other in chosen)
        of_j = any(k == j and together_a[i, other] > _SHARED_SAMPLES for other, k in chosen)
        if not of_i and not of_j:
            chosen.append((i, j))
    return chosen


def _related(
    a: Bearings, b: Bearings, pairs: Sequence[Pair], offsets_s: Sequence[float], seed: int
) -> SharedPeople | None:
    """Return the geometry of some pairs that explains most, and all that it explains."""
    geometries = relate_pair(a, b, tuple(sorted(pairs)), offsets_s=offsets_s, seed=seed)[:2]
    found = [each for each in (_explain(a, b, geometry) for geometry in geometries) if each is not None]
    return max(found, key=lambda each: float(each.support.sum()), default=None)


def _improved(a: Bearings, b: Bearings, start: SharedPeople, seed: int) -> SharedPeople:
    """Estimate the geometry from the matches and the matches from the geometry, as long as that explains more."""
    offsets_s = (start.geometry.offset_s,) if start.geometry.offset_s else ()
    best = start
    for _ in range(_MAX_ROUNDS):
        found = _related(a, b, best.matches[:_MAX_REFINED_PAIRS], offsets_s, seed)
        if found is None or found.support.sum() <= best.support.sum():
            break
        best = found
    return best


def _explain(a: Bearings, b: Bearings, geometry: PairGeometry) -> SharedPeople | None:
    """Return the matches that a geometry explains, or None without any."""
    result = agreement_of(a, b, geometry)
    support = result.support
    matches = exclusive_matches(support, result.together_a, result.together_b)
    if not matches:
        return None
    explained = sum(float(result.samples[pair]) for pair in matches) / max(result.people, 1)
    different = tuple((int(i), int(j)) for i, j in np.argwhere(result.excluded))
    return SharedPeople(geometry, tuple(matches), np.array([support[pair] for pair in matches]), explained, different)


def _voted(a: Bearings, b: Bearings, max_offset_s: float) -> list[tuple[float, list[Pair]]]:
    """Return plausible time offsets and the pairs of tracks that vote for them, the most plausible first."""
    reach = np.ceil(max(max_offset_s, 1.0) / GRID_S)
    grid = GRID_S * np.arange(-reach, reach + 1.0)
    spans_a, spans_b = _spans(a), _spans(b)
    gain = np.zeros((len(grid), a.n_people, b.n_people))
    for i, j in _overlapping(spans_a, spans_b, max_offset_s):
        first, second = track_of(a, i, spans_a), track_of(b, j, spans_b)
        costs = affine_curve(first, second, ((0, 0),), grid, 1.0)
        known = np.isfinite(costs)
        if known.sum() < 3:
            continue
        shared_s = np.minimum(spans_a[i, 1], spans_b[j, 1] + grid) - np.maximum(spans_a[i, 0], spans_b[j, 0] + grid)
        better = np.maximum(np.median(costs[known]) - costs, 0.0) * np.maximum(shared_s, 0.0)
        gain[known, i, j] = better[known]
    gain[np.abs(grid) > max_offset_s + 0.5 * GRID_S] = 0.0
    together_a, together_b = _overlaps(spans_a), _overlaps(spans_b)
    voted = [exclusive_matches(table, together_a, together_b) for table in gain]
    totals = np.array([sum(gain[k][pair] for pair in pairs) for k, pairs in enumerate(voted)])
    padded = np.pad(totals, 1)
    peaks = [k for k in np.argsort(-totals, kind="stable") if totals[k] > 0.0 and totals[k] == padded[k : k + 3].max()]
    out = [(float(grid[k]), voted[k]) for k in peaks[:_MAX_OFFSETS]]
    at_once = voted[len(grid) // 2]
    if at_once and not any(abs(offset) < 1.5 * GRID_S for offset, _ in out):
        out.append((0.0, at_once))
    # People who do not move vote for nothing.
    return out or [(0.0, [pair]) for pair in _overlapping(spans_a, spans_b, 0.0)[:_MAX_REFINED_PAIRS]]


def _spans(view: Bearings) -> np.ndarray:
    """Return the first and last time of every track, shape (track, 2)."""
    out = np.full((view.n_people, 2), np.nan)
    for person in range(view.n_people):
        seen = np.flatnonzero(np.isfinite(view.rays[:, person, :, 0]).any(axis=1))
        if len(seen):
            out[person] = view.time_s[seen[[0, -1]]]
    return out


def _overlaps(spans: np.ndarray) -> np.ndarray:
    """Return whether tracks overlap in time, as a number of samples, shape (track, track)."""
    low, high = np.fmax(spans[:, None, 0], spans[None, :, 0]), np.fmin(spans[:, None, 1], spans[None, :, 1])
    return np.where(high - low > GRID_S, np.inf, 0.0)


def _overlapping(spans_a: np.ndarray, spans_b: np.ndarray, max_offset_s: float) -> list[Pair]:
    """Return the pairs of tracks that may overlap, the longest overlaps first, at most a fixed number."""
    shorter = np.minimum((spans_a[:, 1] - spans_a[:, 0])[:, None], (spans_b[:, 1] - spans_b[:, 0])[None])
    shared = np.minimum(spans_a[:, None, 1], spans_b[None, :, 1] + max_offset_s)
    shared = np.minimum(shared - np.maximum(spans_a[:, None, 0], spans_b[None, :, 0] - max_offset_s), shorter)
    order = np.argsort(-np.nan_to_num(shared, nan=-1.0), axis=None, kind="stable")
    pairs = [np.unravel_index(flat, shared.shape) for flat in order[:_MAX_CURVES]]
    return [(int(i), int(j)) for i, j in pairs if shared[i, j] >= _MIN_OVERLAP_S]


def track_of(view: Bearings, person: int, spans: np.ndarray) -> Bearings:
    """Return one track alone, in its time."""
    first, last = np.searchsorted(view.time_s, spans[person] + [-1e-9, 1e-9])
    return replace(
        view,
        time_s=view.time_s[first:last],
        rays=view.rays[first:last, person : person + 1],
        sigma=view.sigma[first:last, person : person + 1],
    )
