"""Number the people of unrelated pictures alike in all views: the same person index in every view of a frame.

Without tracks, a relative pose of two views is searched over all frames at once: small samples assume that two people
of a few frames are the same, the frames with the fewest people first, and give poses by five points. Each pose matches
the people of every frame; the pose that explains most of them is estimated again from its matches.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from posefuse.calibration.people.bearings import Bearings, bearings_of
from posefuse.calibration.people.five_point import decompose, essential_matrices
from posefuse.calibration.people.pairs import PairGeometry, relate_pair, share_in_front
from posefuse.calibration.people.shared_people import MAX_COST, MAX_LOG_SIZE, exclusive_matches, log_sizes
from posefuse.calibration.people.views import PeopleViews, ViewTracks
from posefuse.kernels.calibration import people_agreement as agreement
from posefuse.kernels.calibration.relative_pose import (
    COLUMNS,
    RAY_A,
    RAY_B,
    VARIANCE_A,
    VARIANCE_B,
    VELOCITY,
    epipolar_costs,
)

_N_SAMPLES = 300
_FRAMES_PER_SAMPLE = 3
_MAX_SCORED_FRAMES = 150
_N_SCORED, _N_IMPROVED = 200, 4
_MAX_ROUNDS = 4
_MIN_KEYPOINTS = 4
_MIN_IN_FRONT = 0.8
_MIN_MATCHES = 8
_STEP_S = 60.0

Match = tuple[int, int, int]
"""Frame, and index of the person in the first and in the second view."""


@dataclass(frozen=True, eq=False)
class MatchedPictures:
    """Hold the relative pose of two views and the people whom it matches.

    Attributes:
        geometry: relative pose.
        support: match to how much more probable it is than an outlier, summed over its points.
    """

    geometry: PairGeometry
    support: Mapping[Match, float]

    @property
    def total(self) -> float:
        """Summed support."""
        return float(sum(self.support.values()))


def with_common_people_in_pictures(people: PeopleViews, seed: int = 0) -> PeopleViews:
    """Return the views with person axes that agree in each frame; people whom one view alone shows are left out.

    Args:
        people: views at the same times, with detections in any order.
        seed: random seed.
    """
    people = _at_all_times(people)
    bearings = [bearings_of(view, people.skeleton) for view in people.views]
    relations = {}
    for a, b in combinations(range(len(bearings)), 2):
        found = match_pictures(bearings[a], bearings[b], seed=seed)
        if found is not None:
            relations[a, b] = found
    groups = _groups(relations, len(people.views[0].time_s))
    return replace(people, views=tuple(_renumbered(view, v, groups) for v, view in enumerate(people.views)))


def _at_all_times(people: PeopleViews) -> PeopleViews:
    """Return views with the same frames: those that any view has."""
    times = np.unique(np.concatenate([view.time_s for view in people.views]))
    views = []
    for view in people.views:
        at = np.searchsorted(times, view.time_s)
        keypoints_px = np.full((len(times), *view.keypoints_px.shape[1:]), np.nan)
        confidence = np.full((len(times), *view.confidence.shape[1:]), np.nan)
        keypoints_px[at], confidence[at] = view.keypoints_px, view.confidence
        views.append(replace(view, time_s=times, keypoints_px=keypoints_px, confidence=confidence))
    return replace(people, views=tuple(views))


def match_pictures(a: Bearings, b: Bearings, *, seed: int = 0) -> MatchedPictures | None:
    """Return the relative pose of two views that matches most people of all frames, or None without one.

    Args:
        a: first view.
        b: second view, at the same times.
        seed: random seed.
    """
    pairs = _low_counts(a, b)
    if len(pairs) < _FRAMES_PER_SAMPLE:
        return None
    poses = _hypotheses(a, b, pairs, np.random.default_rng(seed))
    frames = np.unique([frame for frame, _, _ in pairs])
    frames = frames[np.unique(np.linspace(0, len(frames) - 1, _MAX_SCORED_FRAMES).astype(np.int64))]
    some_a, some_b = _frames(a, frames), _frames(b, frames)
    totals = [_support(some_a, some_b, pose).max(axis=(1, 2)).sum() for pose in poses]
    best: MatchedPictures | None = None
    for k in np.argsort(-np.array(totals), kind="stable")[:_N_IMPROVED]:
        found = _improved(a, b, poses[k], seed)
        if found is not None and (best is None or found.total > best.total):
            best = found
    return best


def _frames(view: Bearings, frames: np.ndarray) -> Bearings:
    """Return some frames of a view."""
    return replace(view, time_s=view.time_s[frames], rays=view.rays[frames], sigma=view.sigma[frames])


def _shared(a: Bearings, b: Bearings) -> np.ndarray:
    """Return the number of keypoints that two people share, shape (frame, person of a, person of b)."""
    seen_a, seen_b = (np.isfinite(view.rays[..., 0]).astype(float) for view in (a, b))
    return np.einsum("fik,fjk->fij", seen_a, seen_b)


def _low_counts(a: Bearings, b: Bearings) -> np.ndarray:
    """Return all pairs of people who share keypoints, shape (pair, 3), in the frames with the fewest pairs."""
    enough = _shared(a, b) >= _MIN_KEYPOINTS
    count = enough.sum(axis=(1, 2))
    pairs = np.argwhere(enough)
    order = np.argsort(count[pairs[:, 0]], kind="stable")
    return pairs[order][: max(_MAX_SCORED_FRAMES, _FRAMES_PER_SAMPLE * int((count == 1).sum()))]


def _table(a: Bearings, b: Bearings, pairs: np.ndarray) -> np.ndarray:
    """Return the corresponding rays of pairs of people, shape (pair, keypoint, COLUMNS), NaN where missing."""
    frame, i, j = pairs.T
    table = np.zeros((len(pairs), a.rays.shape[2], COLUMNS))
    table[..., RAY_A:RAY_B], table[..., RAY_B:VELOCITY] = a.rays[frame, i], b.rays[frame, j]
    table[..., VARIANCE_A], table[..., VARIANCE_B] = a.sigma[frame, i] ** 2, b.sigma[frame, j] ** 2
    table[~(np.isfinite(table[..., RAY_A]) & np.isfinite(table[..., RAY_B]))] = np.nan
    return table


def _hypotheses(a: Bearings, b: Bearings, pairs: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """Return the poses, shape (4, 3), that agree best with the sample of people that each comes from."""
    table = _table(a, b, pairs)
    found: list[tuple[float, np.ndarray]] = []
    for _ in range(_N_SAMPLES):
        points = table[rng.choice(len(pairs), _FRAMES_PER_SAMPLE, replace=False)].reshape(-1, COLUMNS)
        points = np.ascontiguousarray(points[np.isfinite(points[:, 0])])
        five = points[rng.choice(len(points), 5, replace=False)][None]
        essentials = essential_matrices(five[..., RAY_A:RAY_B], five[..., RAY_B:VELOCITY])
        costs = np.empty(len(essentials))
        epipolar_costs(essentials, points, costs)
        for k in np.argsort(costs, kind="stable")[:2]:
            rotations, translation = decompose(essentials[k])
            poses = [np.concatenate([r, sign * translation[None]]) for r in rotations for sign in (1.0, -1.0)]
            shares = [share_in_front(pose, points) for pose in poses]
            if max(shares) >= _MIN_IN_FRONT:
                found.append((float(costs[k]), poses[int(np.argmax(shares))]))
    found.sort(key=lambda each: each[0])
    return [pose for _, pose in found[:_N_SCORED]]


def _support(a: Bearings, b: Bearings, pose: np.ndarray) -> np.ndarray:
    """Return the support of all pairs of people for a pose, shape (frame, person of a, person of b)."""
    results = np.zeros((len(a.time_s), a.n_people, b.n_people, agreement.N_RESULTS))
    agreement.people_agreement(
        np.ascontiguousarray(pose[:3]), pose[3], a.rays, b.rays, a.sigma**2, b.sigma**2, a.mirror, results
    )
    points = results[..., agreement.POINTS]
    behind = results[..., agreement.BEHIND] > (1.0 - _MIN_IN_FRONT) * points
    sizes = np.abs(np.nan_to_num(log_sizes(results, a.rays, b.rays)))
    allowed = (points >= _MIN_KEYPOINTS) & ~behind & (sizes < 1.5 * MAX_LOG_SIZE)
    return np.where(allowed, np.maximum(MAX_COST * points - results[..., agreement.COST], 0.0), 0.0)


def _matched(a: Bearings, b: Bearings, pose: np.ndarray) -> dict[Match, float]:
    """Return the matches of all frames for a pose, with their support."""
    support = _support(a, b, pose)
    together_a, together_b = (np.full((view.n_people, view.n_people), np.inf) for view in (a, b))
    return {
        (int(f), i, j): float(support[f, i, j])
        for f in np.flatnonzero(support.any(axis=(1, 2)))
        for i, j in exclusive_matches(support[f], together_a, together_b)
    }


def _improved(a: Bearings, b: Bearings, pose: np.ndarray, seed: int) -> MatchedPictures | None:
    """Estimate the pose from the matches and the matches from the pose, as long as that explains more."""
    best: MatchedPictures | None = None
    for _ in range(_MAX_ROUNDS):
        matches = _matched(a, b, pose)
        if len(matches) < _MIN_MATCHES or (best is not None and sum(matches.values()) <= best.total):
            break
        geometry = _related(a, b, np.array(list(matches)), seed)
        if geometry is None:
            break
        best = MatchedPictures(geometry, matches)
        pose = np.concatenate([geometry.rotation, geometry.translation[None]])
    return best


def _related(a: Bearings, b: Bearings, matches: np.ndarray, seed: int) -> PairGeometry | None:
    """Return the relative pose from matched people, as if they were one person in as many frames."""
    frame, i, j = matches.T
    time_s = _STEP_S * np.arange(len(matches))
    of_a = replace(a, time_s=time_s, rays=a.rays[frame, i][:, None], sigma=a.sigma[frame, i][:, None])
    of_b = replace(b, time_s=time_s, rays=b.rays[frame, j][:, None], sigma=b.sigma[frame, j][:, None])
    return next(iter(relate_pair(of_a, of_b, offsets_s=(), seed=seed)), None)


def _groups(relations: Mapping[tuple[int, int], MatchedPictures], n_frames: int) -> list[list[dict[int, int]]]:
    """Return the people of each frame: view to index in it, the ones with the most support first."""
    links: list[list[tuple[float, tuple[int, int], tuple[int, int]]]] = [[] for _ in range(n_frames)]
    for (a, b), found in relations.items():
        for (frame, i, j), support in found.support.items():
            links[frame].append((-support, (a, i), (b, j)))
    return [_join(sorted(each)) for each in links]


def _join(links: Sequence[tuple[float, tuple[int, int], tuple[int, int]]]) -> list[dict[int, int]]:
    """Join people of two views in the order of the links, unless a view would show one twice."""
    groups: list[dict[int, int]] = []
    for _, first, second in links:
        touched = [group for group in groups if any(group.get(v) == i for v, i in (first, second))]
        merged = dict([first, second])
        size = len(merged)
        for group in touched:
            size += sum(v not in merged or merged[v] != i for v, i in group.items())
            merged |= group
        if size == len(merged) and merged[first[0]] == first[1] and merged[second[0]] == second[1]:
            groups = [group for group in groups if group not in touched] + [merged]
    return groups


def _renumbered(view: ViewTracks, index: int, groups: Sequence[Sequence[Mapping[int, int]]]) -> ViewTracks:
    """Return a view with the people of each frame in the order of the groups."""
    n_people = max([len(each) for each in groups] + [1])
    shape = (len(view.time_s), n_people, view.keypoints_px.shape[2])
    keypoints_px, confidence = np.full((*shape, 2), np.nan), np.full(shape, np.nan)
    for frame, each in enumerate(groups):
        for person, group in enumerate(each):
            if index in group:
                keypoints_px[frame, person] = view.keypoints_px[frame, group[index]]
                confidence[frame, person] = view.confidence[frame, group[index]]
    return replace(view, keypoints_px=keypoints_px, confidence=confidence)
