"""Match views by the people whom they observe: an approximate calibration from nothing.

Time offsets come from the agreement of motion, relative poses of pairs from epipolar geometry, and the rig from both,
with a bundle adjustment over bodies with rigid bones. Left and right sides are corrected on the way.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from operator import call

import numpy as np

from posefuse.calibration.people.ambiguity import most_probable
from posefuse.calibration.people.assemble import Assembly, assemble
from posefuse.calibration.people.bearings import Bearings, bearings_of
from posefuse.calibration.people.bodies import Bones, bones_of, sample_bodies
from posefuse.calibration.people.conditions import (
    check_filmed_enough,
    check_parallax,
    groups_error,
    has_parallax,
    no_agreement,
    related_rest,
)
from posefuse.calibration.people.cross_validation import check_prediction
from posefuse.calibration.people.identities import common_people, people_table, strangers
from posefuse.calibration.people.pairs import relate_pair
from posefuse.calibration.people.rates import at_rate, rig_rates
from posefuse.calibration.people.repeated_motion import check_repeated_motion
from posefuse.calibration.people.rigs import N_SAMPLES, People, Rig, later, with_exact_times
from posefuse.calibration.people.scale import meters_per_unit
from posefuse.calibration.people.shared_motion import CLEAR_GAIN, MIN_GAIN, weakest_view
from posefuse.calibration.people.sides import exchange_sides, exchanged_sides
from posefuse.calibration.people.time_search import GRID_S, rig_offsets
from posefuse.calibration.people.views import MatchedViews, PeopleViews, ViewTracks
from posefuse.errors import CalibrationError
from posefuse.model.cameras import Camera
from posefuse.parallel import ONE_JOB, Jobs

_GAIN = 1.15
"""Factor by which time offsets must explain the motion better than synchronized views."""
_POOR_COST, _RATE_GAIN = 1.6, 1.1
_TWO, _FEW = 2, 3


@dataclass(frozen=True, eq=False)
class RigSearch:
    """How the rig of some views is searched for.

    Attributes:
        max_offset_s: bound of the time offsets.
        seed: random seed.
        jobs: processes that relate pairs of views.
    """

    max_offset_s: float
    seed: int = 0
    jobs: Jobs = ONE_JOB


def match_views(people: PeopleViews, seed: int = 0, jobs: Jobs = ONE_JOB) -> MatchedViews:
    """Estimate an approximate calibration of views of one or several people, whose correspondence is not known.

    Args:
        people: observations. If a view has several tracks, those of the same person are found first; tracks that only
            one view has are left out.
        seed: random seed.
        jobs: processes that relate pairs of views.

    Raises:
        CalibrationError: if no two views can be related, or the views form unrelated groups; the message says what to
            film.
    """
    common = common_people(people, seed, jobs)
    matched = match_people(common, people_table(common), RigSearch(people.max_offset_s, seed, jobs))
    left_out = {**matched.left_out, **strangers(people, common, matched.left_out)}
    return replace(matched, left_out=left_out, notes=(*people.notes, *matched.notes))


def match_people(people: PeopleViews, table: People, search: RigSearch) -> MatchedViews:
    """Estimate an approximate calibration of views of people whose correspondence is known.

    Args:
        people: observations.
        table: index of each person in every view, -1 where a view does not observe it.
        search: how to search.

    Raises:
        CalibrationError: if no two views can be related, or the views form unrelated groups.
    """
    bearings = [bearings_of(view, people.skeleton) for view in people.views]
    left_out = check_filmed_enough(bearings, table)
    used = [v for v in range(len(bearings)) if bearings[v].name not in left_out]
    views = [bearings[v] for v in used]
    table = [[person[v] for v in used] for person in table]
    focal_known = np.array([people.views[v].focal_known for v in used])
    bones = bones_of(people.skeleton, views[0].keypoints)
    agreeing, rig = _agreeing_views(views, table, bones, focal_known, search)
    left_out |= {views[v].name: _rejection(0.0) for v in range(len(views)) if v not in agreeing}
    left_out |= {views[agreeing[v]].name: _rejection(median) for v, median in rig.assembly.rejected.items()}
    timed = [at_rate(views[v], rate) for v, rate in zip(agreeing, rig.rate, strict=True)]
    rig = _settled(timed, _of_views(table, agreeing), bones, focal_known[agreeing], rig)
    check_repeated_motion(timed, _of_views(table, agreeing), bones, focal_known[agreeing], rig, people.max_offset_s)
    check_prediction(timed, bones, focal_known[agreeing], rig.assembly)
    chosen = [agreeing[v] for v in rig.assembly.views]
    timed = [timed[v] for v in rig.assembly.views]
    return _matched(people, [used[v] for v in chosen], timed, _of_views(table, chosen), rig, left_out)


def _of_views(table: People, views: Sequence[int]) -> list[list[int]]:
    """Return the index of each person in some views."""
    return [[person[v] for v in views] for person in table]


def _agreeing_views(
    views: Sequence[Bearings], table: People, bones: Bones, focal_known: np.ndarray, search: RigSearch
) -> tuple[list[int], Rig]:
    """Return the views that agree, and their rig, in which some may be rejected.

    Raises:
        CalibrationError: if no views agree, or they form unrelated groups.
    """
    used = list(range(len(views)))
    while True:
        chosen, people = [views[v] for v in used], _of_views(table, used)
        rig = best_rig(chosen, people, bones, focal_known[used], search)
        if rig is None:
            raise CalibrationError(no_agreement([view.name for view in chosen], search.max_offset_s))
        rest = related_rest(chosen, people, rig.assembly, search.seed)
        if rest:
            raise CalibrationError(groups_error(chosen, rig.assembly.views, rest))
        weakest, gain = weakest_view(chosen, people, bones, focal_known[used], rig, search.seed)
        if gain > (CLEAR_GAIN if len(rig.assembly.views) < min(len(used), _FEW) else MIN_GAIN):
            return used, rig
        if len(used) == _FEW:
            return _best_pair(views, table, bones, focal_known, used, search)
        if len(used) < _FEW:
            raise CalibrationError(no_agreement([view.name for view in chosen], search.max_offset_s))
        used.remove(used[weakest])


def _best_pair(
    views: Sequence[Bearings],
    table: People,
    bones: Bones,
    focal_known: np.ndarray,
    used: Sequence[int],
    search: RigSearch,
) -> tuple[list[int], Rig]:
    """Return the two of some views that agree best, and their rig.

    Of three views, a wrong one spoils the agreement of the others.

    Raises:
        CalibrationError: if no two of them agree.
    """
    found: list[tuple[float, list[int], Rig]] = []
    for pair in combinations(used, 2):
        chosen, people = [views[v] for v in pair], _of_views(table, pair)
        shared = _of_both(table, pair)
        rig = best_rig(chosen, people, bones, focal_known[list(pair)], search) if shared else None
        if rig is not None:
            gain = weakest_view(chosen, people, bones, focal_known[list(pair)], rig, search.seed)[1]
            found.append((gain, list(pair), rig))
    gain, best, rig = max(found, key=lambda each: each[0], default=(0.0, [], None))
    if rig is None or gain <= (CLEAR_GAIN if len(found) > 1 else MIN_GAIN):
        raise CalibrationError(no_agreement([views[v].name for v in used], search.max_offset_s))
    return best, rig


def _of_both(table: People, pair: Sequence[int]) -> tuple[tuple[int, int], ...]:
    """Return the people whom two views share, by their index in both."""
    a, b = pair
    return tuple((person[a], person[b]) for person in table if person[a] >= 0 and person[b] >= 0)


def best_rig(
    views: Sequence[Bearings], table: People, bones: Bones, focal_known: np.ndarray, search: RigSearch
) -> Rig | None:
    """Return the best rig; where views do not agree, some of them may have a wrong frame rate."""
    best = _rig_at_rates(views, table, bones, focal_known, search)
    if best is None or best.assembly.rejected or best.assembly.cost > _POOR_COST:
        rate = rig_rates(views, table, search.max_offset_s)
        if (rate != 1.0).any():
            timed = [at_rate(view, ratio) for view, ratio in zip(views, rate, strict=True)]
            other = _rig_at_rates(timed, table, bones, focal_known, search)
            if other is not None and (best is None or other.assembly.support > _RATE_GAIN * best.assembly.support):
                return replace(other, rate=rate)
    return best


def _rig_at_rates(
    views: Sequence[Bearings], table: People, bones: Bones, focal_known: np.ndarray, search: RigSearch
) -> Rig | None:
    """Return the best rig: with synchronized views, or with time offsets if they explain the motion better."""
    rate = np.ones(len(views))
    apart = [start for start in rig_offsets(views, table, rate, search.max_offset_s) if np.abs(start).max() > GRID_S]
    rigs: list[Rig] = []
    for start in (np.zeros(len(views)), *apart):
        samples = sample_bodies(views, table, start, rate, N_SAMPLES)
        pairs = (
            (
                (a, b),
                partial(relate_pair, views[a], views[b], shared, offsets_s=[start[b] - start[a]], seed=search.seed),
            )
            for a, b in combinations(range(len(views)), 2)
            if (shared := _of_both(table, (a, b)))
        )
        edges = dict(search.jobs.in_order_with(call, pairs))
        if not start.any():
            check_parallax([view.name for view in views], edges)
        elif not has_parallax(edges):
            continue
        found = assemble(samples, bones, edges, focal_known, True)
        if found:
            rigs.append(Rig(found[0], later(start, found[0]), rate, tuple(found[1:])))
    if len(rigs) < _TWO:
        return rigs[0] if rigs else None
    best = max(rigs[1:], key=_plausibility)
    return best if _is_clearly_better(best.assembly, rigs[0].assembly) else rigs[0]


def _plausibility(rig: Rig) -> tuple[int, float]:
    """Return the number of views, and how probable one of their observations is on average."""
    return len(rig.assembly.views), rig.assembly.likelihood / np.isfinite(rig.assembly.samples.observed[..., 0]).sum()


def _settled(views: Sequence[Bearings], table: People, bones: Bones, focal_known: np.ndarray, rig: Rig) -> Rig:
    """Return the most probable rig at its exact times."""
    return with_exact_times(views, table, bones, focal_known, most_probable(views, table, bones, focal_known, rig))


def _is_clearly_better(a: Assembly, b: Assembly) -> bool:
    """Return whether an assembly explains the observations clearly better than another.

    The motion of a walk is nearly the same some steps later elsewhere, which fits about as well.
    """
    if len(a.views) > len(b.views):
        return a.support > _GAIN * b.support
    return a.support > b.support and _GAIN * a.cost < b.cost


def _rejection(median: float) -> str:
    if not np.isfinite(median):
        return (
            "It shares too few detections of a person with the other cameras. Film the person where its image overlaps "
            "with theirs."
        )
    return (
        "The motion in it does not agree with the other cameras: no pose explains it. Film the person where its image "
        "overlaps with theirs, and check its intrinsics and its clock."
    )


def _matched(
    people: PeopleViews,
    kept: list[int],
    views: list[Bearings],
    table: People,
    rig: Rig,
    left_out: dict[str, str],
) -> MatchedViews:
    """Return the result in meters, with corrected sides in all frames."""
    state, assembly = rig.assembly.state, rig.assembly
    chosen = list(assembly.views)
    offset_s, rate = rig.offset_s[chosen], rig.rate[chosen] / rig.rate[chosen[0]]
    factor = meters_per_unit(people.skeleton, views[0].keypoints, state.points)
    exchanged = exchanged_sides(views, table, (state.rotations, state.centers), (offset_s, np.ones(len(kept))))
    out, notes = [], []
    for i, v in enumerate(kept):
        camera = _posed(people.views[v].camera, state.rotations[i], factor * state.centers[i], state.log_focal[i])
        view = _with_people(people.views[v], [person[i] for person in table])
        out.append(replace(exchange_sides(view, people.skeleton.mirror, exchanged[i]), camera=camera))
        seen = np.isfinite(view.keypoints_px).any(axis=(2, 3))
        share = float(exchanged[i][seen].mean()) if seen.any() else 0.0
        if share > 0.0:
            notes.append(
                f"{camera.name}: left and right were exchanged in {100 * share:.1f} % of the detections; corrected."
            )
        if rate[i] != 1.0:
            notes.append(f"{camera.name}: its frame rate is {1.0 / rate[i]:.3g} times as high as stated; corrected.")
    start_s = offset_s + np.array([view.time_s[0] for view in out]) * (1.0 - rig.rate[chosen])
    return MatchedViews(
        people.skeleton, tuple(out), (start_s - start_s[0]) / rig.rate[chosen[0]], rate, left_out, tuple(notes)
    )


def _with_people(view: ViewTracks, indices: list[int]) -> ViewTracks:
    """Return a view with the people in another order; missing ones are NaN."""
    chosen = np.array(indices)
    absent = chosen < 0
    pixels, confidence = view.keypoints_px[:, chosen].copy(), view.confidence[:, chosen].copy()
    pixels[:, absent], confidence[:, absent] = np.nan, np.nan
    return replace(view, keypoints_px=pixels, confidence=confidence)


def _posed(camera: Camera, rotation: np.ndarray, center: np.ndarray, log_focal: float) -> Camera:
    """Return a camera with its approximate pose and focal length."""
    pose, matrix = np.eye(4), camera.matrix.copy()
    # Products of rotations drift off orthogonality by rounding.
    left, _, right = np.linalg.svd(rotation)
    pose[:3, :3] = left @ right
    pose[:3, 3] = -pose[:3, :3] @ center
    matrix[:2, :2] *= np.exp(log_focal)
    return replace(camera, matrix=matrix, camera_from_world=pose)
