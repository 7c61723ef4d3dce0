"""Number the people of all views alike: tracks of different views that show the same person, with unknown cameras.

Every pair of views is searched for one geometry that explains many pairs of tracks at once (:mod:`.shared_people`).
Pairs of views whose geometries agree around a triangle of views are trusted first. Tracks are then joined in the order
of their support, unless a view would show one person twice at the same time, or a geometry excludes it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from operator import call

import numpy as np

from posefuse.calibration.people.bearings import bearings_of
from posefuse.calibration.people.pairs import PairGeometry
from posefuse.calibration.people.pictures import with_common_people_in_pictures
from posefuse.calibration.people.shared_people import CLEARLY_EXPLAINED, SharedPeople, shared_people
from posefuse.calibration.people.views import PeopleViews, ViewTracks
from posefuse.errors import CalibrationError
from posefuse.parallel import ONE_JOB, Jobs

MOST_PEOPLE = 8
"""Most people that are used; those with the most observations in several views are kept."""
_MAX_LOOP_DEG = 25.0
_MAX_LOOP_S = 0.25
_COMPARED_PER_JOB = 16
"""Pairs of tracks whose comparison takes longer than the start of a process."""

Track = tuple[int, int]
"""View and index of a track in it."""


@dataclass(frozen=True, eq=False)
class Identities:
    """Hold which tracks show the same person.

    Attributes:
        people: by person, the tracks of all views, those with the most observations first.
        relations: what pairs of views have in common, by views; only those that are trusted.
    """

    people: tuple[tuple[Track, ...], ...]
    relations: Mapping[tuple[int, int], SharedPeople]


def useful_jobs(people: PeopleViews) -> int:
    """Return the number of processes beyond which matching the tracks of views does not profit."""
    counts = [view.keypoints_px.shape[1] for view in people.views]
    return max(sum(a * b for a, b in combinations(counts, 2)) // _COMPARED_PER_JOB, 1)


def common_people(people: PeopleViews, seed: int = 0, jobs: Jobs = ONE_JOB) -> PeopleViews:
    """Return the views with person axes that agree.

    Args:
        people: tracks of each view, or people of unrelated pictures, without a relation between the views. Views that
            hold one track each show the same person.
        seed: random seed.
        jobs: processes that compare pairs of views.

    Raises:
        CalibrationError: if no two views have a person in common.
    """
    if max(view.keypoints_px.shape[1] for view in people.views) == 1:
        return people
    if people.tracked:
        common = with_common_people(people, seed=seed, jobs=jobs)
    else:
        common = with_common_people_in_pictures(people, seed=seed)
    if not np.any(np.sum(np.array(people_table(common)) >= 0, axis=1) > 1):
        names = ", ".join(view.camera.name for view in people.views)
        raise CalibrationError(
            f"No person is recognized in two of the cameras {names}: no pose explains the motion of several people. "
            "Film one person or few people who walk where all cameras see them, and check the intrinsics; clocks may "
            f"differ by up to {people.max_offset_s:g} s (`max_offset_s`)."
        )
    return common


def people_table(people: PeopleViews) -> list[list[int]]:
    """Return the index of each person in every view, -1 where a view does not show them, for agreeing person axes."""
    shown = np.array([np.isfinite(view.keypoints_px).any(axis=(0, 2, 3)) for view in people.views])
    return [[person if seen else -1 for seen in row] for person, row in enumerate(shown.T.tolist())]


def strangers(people: PeopleViews, common: PeopleViews, names: Iterable[str]) -> dict[str, str]:
    """Return the reason for each named view whose people are not seen by other views."""
    reason = (
        "None of the people in it is recognized in another camera. Film people where its image overlaps with others, "
        "and check its intrinsics and its clock."
    )
    return {
        before.camera.name: reason
        for before, after in zip(people.views, common.views, strict=True)
        if before.camera.name in set(names)
        and np.isfinite(before.keypoints_px).any()
        and not np.isfinite(after.keypoints_px).any()
    }


def with_common_people(people: PeopleViews, *, seed: int = 0, jobs: Jobs = ONE_JOB) -> PeopleViews:
    """Return the views with person axes that agree; tracks that match no track of another view are left out.

    Args:
        people: tracks of each view, without a relation between the views.
        seed: random seed.
        jobs: processes that compare pairs of views.
    """
    found = identify_people(people, seed=seed, jobs=jobs)
    views = [_renumbered(view, v, found.people) for v, view in enumerate(people.views)]
    return replace(people, views=tuple(views))


def identify_people(people: PeopleViews, *, seed: int = 0, jobs: Jobs = ONE_JOB) -> Identities:
    """Return which tracks of the views show the same person; arguments as of :func:`with_common_people`."""
    bearings = [bearings_of(view, people.skeleton) for view in people.views]
    compare = partial(shared_people, max_offset_s=people.max_offset_s, seed=seed)
    pairs = (((a, b), partial(compare, bearings[a], bearings[b])) for a, b in combinations(range(len(bearings)), 2))
    relations = {views: found for views, found in jobs.in_order_with(call, pairs) if found is not None}
    trusted = _trusted(relations)
    seen = [_seen_times(view) for view in people.views]
    groups = _groups(relations, trusted, seen)
    counts = [sum(int(seen[v][:, t].sum()) for v, t in group) for group in groups]
    order = np.argsort(-np.array(counts, dtype=float), kind="stable")[:MOST_PEOPLE]
    return Identities(tuple(tuple(sorted(groups[k])) for k in order), {pair: relations[pair] for pair in trusted})


def _seen_times(view: ViewTracks) -> np.ndarray:
    """Return whether each track is seen in each frame, shape (frame, track)."""
    return np.asarray(np.isfinite(view.keypoints_px[..., 0]).any(axis=2))


def _trusted(relations: Mapping[tuple[int, int], SharedPeople]) -> list[tuple[int, int]]:
    """Return the pairs of views that are used, the most trusted first.

    A pair that explains most people is trusted, and another one if rotations and time offsets agree around a triangle
    with two trusted pairs. A camera that sees other people can agree with one view by chance, and then also with a
    second one, because people whose paths are known in two views fit its images equally well from the same place.
    """
    strong = {pair for pair, found in relations.items() if found.explained > CLEARLY_EXPLAINED}
    strong -= {pair for pair in strong if _is_contradicted(pair, strong, relations)}
    weak = {pair for pair in relations if pair not in strong and _is_confirmed(pair, strong, relations)}
    used = (strong | weak) or set(relations)
    return sorted(used, key=lambda pair: (pair not in strong, -float(relations[pair].support.sum()), pair))


def _is_contradicted(
    pair: tuple[int, int], strong: set[tuple[int, int]], relations: Mapping[tuple[int, int], SharedPeople]
) -> bool:
    """Return whether most triangles do not close, and this pair has the least support in them."""
    against = closed = 0
    for sides in _triangles(pair, strong):
        if _closes(*(relations[side].geometry for side in sides)):
            closed += 1
        elif pair == min(sides, key=lambda side: float(relations[side].support.sum())):
            against += 1
    return against > closed


def _is_confirmed(
    pair: tuple[int, int], strong: set[tuple[int, int]], relations: Mapping[tuple[int, int], SharedPeople]
) -> bool:
    """Return whether a triangle with two trusted pairs closes."""
    return any(_closes(*(relations[side].geometry for side in sides)) for sides in _triangles(pair, strong | {pair}))


def _triangles(pair: tuple[int, int], pairs: set[tuple[int, int]]) -> Iterable[list[tuple[int, int]]]:
    """Yield the triangles of views that contain a pair: first to second, second to third, first to third."""
    for view in sorted({view for each in pairs for view in each} - set(pair)):
        a, b, c = sorted((*pair, view))
        if {(a, b), (b, c), (a, c)} <= pairs:
            yield [(a, b), (b, c), (a, c)]


def _closes(first: PairGeometry, second: PairGeometry, direct: PairGeometry) -> bool:
    """Return whether two relations in sequence agree with the direct one."""
    loop = second.rotation @ first.rotation @ direct.rotation.T
    angle_deg = np.degrees(np.arccos(np.clip(0.5 * (np.trace(loop) - 1.0), -1.0, 1.0)))
    late_s = first.offset_s + first.rate * second.offset_s - direct.offset_s
    return bool(angle_deg < _MAX_LOOP_DEG and abs(late_s) < _MAX_LOOP_S)


def _groups(
    relations: Mapping[tuple[int, int], SharedPeople], trusted: Iterable[tuple[int, int]], seen: list[np.ndarray]
) -> list[set[Track]]:
    """Return groups of tracks of one person each, joined in the order of trust and support."""
    links: list[tuple[float, Track, Track]] = []
    different: set[tuple[Track, Track]] = set()
    for a, b in trusted:
        found = relations[a, b]
        links += [
            (float(support), (a, i), (b, j)) for support, (i, j) in zip(found.support, found.matches, strict=True)
        ]
        different |= {((a, i), (b, j)) for i, j in found.different}
    links.sort(key=lambda link: (-link[0], link[1], link[2]))
    group_of: dict[Track, set[Track]] = {}
    for _, first, second in links:
        one, other = group_of.get(first, {first}), group_of.get(second, {second})
        if one is not other and _compatible(one, other, different, seen):
            merged = one | other
            for track in merged:
                group_of[track] = merged
    return list({id(group): group for group in group_of.values()}.values())


def _compatible(
    one: set[Track], other: set[Track], different: set[tuple[Track, Track]], seen: list[np.ndarray]
) -> bool:
    """Return whether two groups can be one person."""
    for (v, s), (w, t) in ((first, second) for first in one for second in other):
        if v == w and (seen[v][:, s] & seen[v][:, t]).any():
            return False
        if ((v, s), (w, t)) in different or ((w, t), (v, s)) in different:
            return False
    return True


def _renumbered(view: ViewTracks, index: int, people: Iterable[Iterable[Track]]) -> ViewTracks:
    """Return a view with the tracks of each person in one place."""
    groups = [[t for v, t in group if v == index] for group in people] or [[]]
    shape = (len(view.time_s), len(groups), view.keypoints_px.shape[2])
    keypoints_px, confidence = np.full((*shape, 2), np.nan), np.full(shape, np.nan)
    for person, tracks in enumerate(groups):
        for track in tracks:
            there = np.isfinite(view.keypoints_px[:, track, :, 0]).any(axis=1)
            keypoints_px[there, person] = view.keypoints_px[there, track]
            confidence[there, person] = view.confidence[there, track]
    return replace(view, keypoints_px=keypoints_px, confidence=confidence)
