"""Match views by the people whom they observe: an approximate calibration from nothing.

Time offsets come from the agreement of motion, relative poses of pairs from epipolar geometry, and the rig from both,
with a bundle adjustment over bodies with rigid bones. Left and right sides are corrected on the way.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from posefuse.calibration.people.assemble import Assembly, assemble, free_parameters, readjust
from posefuse.calibration.people.bearings import Bearings, bearings_of
from posefuse.calibration.people.bodies import Bones, bones_of, sample_bodies
from posefuse.calibration.people.conditions import check_filmed_enough, check_parallax, groups_error, related_rest
from posefuse.calibration.people.identities import common_people, people_table, strangers
from posefuse.calibration.people.pairs import relate_pair
from posefuse.calibration.people.rates import at_rate, rig_rates
from posefuse.calibration.people.scale import meters_per_unit
from posefuse.calibration.people.sides import exchange_sides, exchanged_sides
from posefuse.calibration.people.time_search import GRID_S, rig_offsets
from posefuse.calibration.people.views import MatchedViews, PeopleViews, ViewTracks
from posefuse.errors import CalibrationError
from posefuse.model.cameras import Camera

N_SAMPLES = 60
_GAIN = 1.15
"""Factor by which time offsets must explain the motion better than synchronized views."""
_POOR_COST, _RATE_GAIN = 1.6, 1.1
_TIME_ITERATIONS, _EXACT_S = 3, 0.01

People = Sequence[Sequence[int]]


@dataclass(frozen=True, eq=False)
class Rig:
    """Hold an assembly of views and their time offsets.

    Attributes:
        assembly: poses.
        offset_s: shape (view,), of all views: true time minus timestamp, after a correction of the rates from the first
            timestamp of each view on.
        rate: shape (view,), of all views: true seconds per second of the timestamps.
    """

    assembly: Assembly
    offset_s: np.ndarray
    rate: np.ndarray


def match_views(people: PeopleViews, seed: int = 0) -> MatchedViews:
    """Estimate an approximate calibration of views of one or several people, whose correspondence is not known.

    Args:
        people: observations. If a view has several tracks, those of the same person are found first; tracks that only
            one view has are left out.
        seed: random seed.

    Raises:
        CalibrationError: if no two views can be related, or the views form unrelated groups; the message says what to
            film.
    """
    common = common_people(people, seed)
    matched = match_people(common, people_table(common), seed)
    left_out = {**matched.left_out, **strangers(people, common, matched.left_out)}
    return replace(matched, left_out=left_out, notes=(*people.notes, *matched.notes))


def match_people(people: PeopleViews, table: People, seed: int = 0) -> MatchedViews:
    """Estimate an approximate calibration of views of people whose correspondence is known.

    Args:
        people: observations.
        table: index of each person in every view, -1 where a view does not observe it.
        seed: random seed.

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
    rig = best_rig(views, table, bones, focal_known, seed)
    if rig is None:
        raise CalibrationError(
            f"The motion in the views of {', '.join(view.name for view in views)} does not agree. Check that the "
            "cameras film the same person at the same time (clocks may differ by up to 2 s), and that their "
            "intrinsics are correct."
        )
    rest = related_rest(views, table, rig.assembly, seed)
    if rest:
        raise CalibrationError(groups_error(views, rig.assembly.views, rest))
    for v, median in rig.assembly.rejected.items():
        left_out[views[v].name] = _rejection(median)
    kept = [used[v] for v in rig.assembly.views]
    table = [[person[v] for v in rig.assembly.views] for person in table]
    timed = [at_rate(views[v], rig.rate[v]) for v in rig.assembly.views]
    return _matched(people, kept, timed, table, rig, left_out)


def best_rig(views: Sequence[Bearings], table: People, bones: Bones, focal_known: np.ndarray, seed: int) -> Rig | None:
    """Return the best rig; where views do not agree, some of them may have a wrong frame rate."""
    best = _rig_at_rates(views, table, bones, focal_known, seed)
    if best is None or best.assembly.rejected or best.assembly.cost > _POOR_COST:
        rate = rig_rates(views, table)
        if (rate != 1.0).any():
            timed = [at_rate(view, ratio) for view, ratio in zip(views, rate, strict=True)]
            other = _rig_at_rates(timed, table, bones, focal_known, seed)
            if other is not None and (best is None or other.assembly.support > _RATE_GAIN * best.assembly.support):
                return replace(other, rate=rate)
    return best


def _rig_at_rates(
    views: Sequence[Bearings], table: People, bones: Bones, focal_known: np.ndarray, seed: int
) -> Rig | None:
    """Return the best rig: with synchronized views, or with time offsets if they explain the motion better."""
    rate = np.ones(len(views))
    synchronized = np.zeros(len(views))
    offset_s = rig_offsets(views, table, rate)
    rigs = []
    for start in (synchronized, offset_s) if np.abs(offset_s).max() > GRID_S else (synchronized,):
        samples = sample_bodies(views, table, start, rate, N_SAMPLES)
        edges = {
            (a, b): relate_pair(views[a], views[b], shared, offsets_s=[start[b] - start[a]], seed=seed)
            for a, b in combinations(range(len(views)), 2)
            if (shared := tuple((p[a], p[b]) for p in table if p[a] >= 0 and p[b] >= 0))
        }
        check_parallax([view.name for view in views], edges)
        assembly = assemble(samples, bones, edges, focal_known, True)
        if assembly is not None:
            rigs.append(Rig(assembly, _later(start, assembly), rate))
    best = rigs[0] if rigs else None
    if len(rigs) == 2 and _is_clearly_better(rigs[1].assembly, rigs[0].assembly):
        best = rigs[1]
    return None if best is None else _with_exact_times(views, table, bones, focal_known, best)


def _is_clearly_better(a: Assembly, b: Assembly) -> bool:
    """Return whether an assembly explains the observations clearly better than another.

    The motion of a walk is nearly the same some steps later elsewhere, which fits about as well.
    """
    if len(a.views) > len(b.views):
        return a.support > _GAIN * b.support
    return a.support > b.support and _GAIN * a.cost < b.cost


def _later(offset_s: np.ndarray, assembly: Assembly) -> np.ndarray:
    """Return the time offsets after an adjustment, relative to the first view of the assembly."""
    moved = offset_s.copy()
    # Observations that are taken later belong to an earlier timestamp of the true time.
    moved[list(assembly.views)] -= assembly.state.shift_s
    return moved - moved[assembly.views[0]]


def _with_exact_times(views: Sequence[Bearings], table: People, bones: Bones, focal_known: np.ndarray, rig: Rig) -> Rig:
    """Return the rig adjusted to samples at its own time offsets: between frames, motion is only nearly linear."""
    chosen = list(rig.assembly.views)
    people = [[person[v] for v in chosen] for person in table]
    free = free_parameters(focal_known[chosen], True)
    for _ in range(_TIME_ITERATIONS):
        moved = np.abs(rig.assembly.state.shift_s).max()
        samples = sample_bodies(
            [views[v] for v in chosen], people, rig.offset_s[chosen], np.ones(len(chosen)), 2 * N_SAMPLES
        )
        assembly = readjust(rig.assembly, samples, bones, free)
        rig = replace(rig, assembly=assembly, offset_s=_later(rig.offset_s, assembly))
        if moved < _EXACT_S:
            break
    return rig


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
            notes.append(f"{camera.name}: left and right were exchanged in {share:.1%} of the detections; corrected.")
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
