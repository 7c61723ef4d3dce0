"""A calibration refined from what its cameras saw: triangulate, adjust, triangulate anew, until nothing changes.

In each round the detections that other views contradict are left out; cameras that cannot be helped are left out by
name. See docs/calibration.md.
"""

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from posefuse.calibration import checks
from posefuse.calibration.adjust import Adjusted, adjust
from posefuse.calibration.gauge import align, gauge_of, pose_changes, reach_of, rescaled
from posefuse.calibration.locate import locate
from posefuse.calibration.normal import rows_of
from posefuse.calibration.parameters import Freedom, Refine, with_distortion
from posefuse.calibration.selection import held_out, spread_out
from posefuse.calibration.sightings import Sightings
from posefuse.calibration.uncertainty import Certainty, certainty
from posefuse.errors import CalibrationError, choices
from posefuse.model.cameras import CameraRig
from posefuse.model.options.refinement import RefineOptions
from posefuse.progress import Progress

_SHARES = (0.3, 0.6, 1.0, 1.0)
_AGREES = 0.5
_LARGEST_START = 0.05
_SETTLED = 0.02


@dataclass(frozen=True, eq=False)
class Gathered:
    """What a rig's cameras saw, triangulated with it.

    Attributes:
        sightings: all of it, of points that at least two views show.
        used: shape (observation,), bool: whether it agrees with the other views.
        error_px: shape (observation,): its distance from the projected point.
    """

    sightings: Sightings
    used: np.ndarray
    error_px: np.ndarray

    def medians(self, n_views: int, chosen: np.ndarray | None = None) -> np.ndarray:
        """Shape (view,): median error in the chosen frames, NaN where a view saw nothing."""
        return np.array([_median(each) for each in self._by_view(self.error_px, n_views, chosen)])

    def shares(self, n_views: int, chosen: np.ndarray | None = None) -> np.ndarray:
        """Shape (view,): share of the observations that agree with other views, NaN where there are none."""
        return np.array([each.mean() if len(each) else np.nan for each in self._by_view(self.used, n_views, chosen)])

    def _by_view(self, values: np.ndarray, n_views: int, chosen: np.ndarray | None) -> list[np.ndarray]:
        seen = self.sightings
        kept = np.ones(len(values), dtype=bool) if chosen is None else chosen[seen.frame][seen.point]
        return [values[kept & (seen.view == v)] for v in range(n_views)]


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else float("nan")


class Evidence(Protocol):
    """A recording, as a refinement needs it."""

    @property
    def n_frames(self) -> int:
        """How many frames are looked at."""
        ...

    def gather(self, rig: CameraRig) -> Gathered:
        """Triangulate with some cameras."""
        ...

    def seen_by(self, name: str, sightings: Sightings) -> np.ndarray:
        """What one more camera saw of points: shape (point, 2), NaN where nothing."""
        ...


@dataclass(frozen=True, eq=False)
class Progressed:
    """How far a refinement is.

    Attributes:
        before: the cameras that are still in, as given; those located from scratch as they were located.
        rig: the same, as refined so far.
        located: names of those located from scratch.
        left_out: name to why.
        doubted: names of those that most others contradicted, as they were given.
        covered: shape (view,), bool, of the last round: whether what a view saw is all over its image.
        adjusted: of the last round.
        sightings: that it was made from.
    """

    before: CameraRig
    rig: CameraRig
    located: tuple[str, ...] = ()
    left_out: dict[str, str] = field(default_factory=dict)
    doubted: tuple[str, ...] = ()
    covered: np.ndarray | None = None
    adjusted: Adjusted | None = None
    sightings: Sightings | None = None

    def without(self, why: dict[str, str]) -> "Progressed":
        """Without some cameras."""
        kept = [name for name in self.rig.names if name not in why]
        if len(kept) < 2:
            reasons = " ".join(f"Camera {name!r}: {reason}" for name, reason in {**self.left_out, **why}.items())
            raise CalibrationError(f"Fewer than two cameras are left to refine. {reasons}")
        return replace(
            self, before=self.before.select(kept), rig=self.rig.select(kept), left_out={**self.left_out, **why}
        )

    @property
    def trusted(self) -> np.ndarray:
        """Shape (view,), bool: cameras whose given pose says where the world is."""
        return np.array([name not in self.located for name in self.rig.names])


def refine(
    given: CameraRig, evidence: Evidence, options: RefineOptions, progress: Progress
) -> tuple[Progressed, Certainty]:
    """Refine the cameras of a rig.

    Args:
        given: the cameras, in the order of the recording's views.
        evidence: what they saw.
        options: what may change.
        progress: told how far the work is.

    Returns:
        The refined cameras, and how well they are known.

    Raises:
        CalibrationError: if what was seen does not determine them.
    """
    kept = [name for name in given.names if name not in options.relocate]
    for name in (*options.fix, *options.relocate):
        given.index(name)
    if len(kept) < 2:
        raise CalibrationError("Two cameras at least must keep the poses they have; the others are located by them.")
    rig = with_distortion(given) if options.refine == "lens" else given
    state = Progressed(rig.select(kept), rig.select(kept))
    progress.start("refining", len(_SHARES) * (2 if options.relocate else 1))
    state = _rounds(state, evidence, options, progress)
    if options.relocate:
        state = _relocated(state, given, evidence, options)
        state = _rounds(state, evidence, options, progress)
    progress.finish()
    known = _known(state, options)
    assert state.adjusted is not None
    checks.must_determine(known, state.rig, reach_of(state.rig, state.adjusted.points_m))
    return state, known


def _known(state: Progressed, options: RefineOptions) -> Certainty:
    """How well the cameras are known after a round."""
    assert state.adjusted is not None
    assert state.sightings is not None
    freedom, fixed = _freedom(state, options), _fixed(state, options)
    gauge = gauge_of(state.before, state.rig, state.adjusted.points_m, fixed, state.trusted)
    return certainty(state.adjusted, state.sightings, freedom, gauge)


def _rounds(state: Progressed, evidence: Evidence, options: RefineOptions, progress: Progress) -> Progressed:
    """Rounds of triangulation and adjustment until the cameras stay where they are."""
    for share in _SHARES:
        last = state.rig
        state, gathered = _joined(state, evidence)
        state = _adjusted(state, gathered, evidence.n_frames, options, share)
        progress.advance(1)
        hopeless = _hopeless(state, options, unfit=share == 1.0)
        if hopeless:
            state = state.without(hopeless)
            continue
        if share == 1.0 and _same(last, state):
            break
    return state


def _joined(state: Progressed, evidence: Evidence) -> tuple[Progressed, Gathered]:
    """What the cameras see, those left out that are copies of others or share too little with them."""
    while True:
        gathered = evidence.gather(state.rig)
        n, names = len(state.rig), state.rig.names
        copy = checks.copy_of(state.rig, np.nan_to_num(gathered.shares(n)))
        if copy is not None:
            a, b = names[copy[0]], names[copy[1]]
            state = state.without({a: f"its pose is a copy of camera {b!r}'s, and fits the other views worse."})
            continue
        checks.must_suffice(gathered.sightings)
        alone = checks.strangers(gathered.sightings, n)
        if not alone:
            return state, gathered
        why = {
            names[v]: f"it shares no more than {shared} points with any other; {checks.FEWEST_SHARED} are needed."
            for v, shared in alone.items()
        }
        state = state.without(why)


def _adjusted(state: Progressed, gathered: Gathered, n_frames: int, options: RefineOptions, share: float) -> Progressed:
    """One adjustment, in the world of the cameras as given."""
    n = len(state.rig)
    # A camera that most others contradict is off itself: all it saw counts. Else what agrees does.
    doubted = np.nan_to_num(gathered.shares(n)) < _AGREES
    seen, error = gathered.sightings, gathered.error_px
    if state.adjusted is None:
        state = replace(state, doubted=tuple(name for name, off in zip(state.rig.names, doubted, strict=True) if off))
    kept = (gathered.used | doubted[seen.view]) & ~held_out(n_frames)[seen.frame][seen.point]
    medians = np.array([_median(error[kept & (seen.view == v)]) for v in range(n)])
    sightings = seen.keep(kept)
    sightings = sightings.of_points(spread_out(sightings, n, int(share * options.max_points)))
    checks.must_suffice(sightings)
    side = max(max(camera.size_px) for camera in state.rig.cameras)
    start_px = min(float(np.nanmax(medians)), _LARGEST_START * side)
    state = replace(state, covered=np.array([checks.covers(state.rig, seen, v) for v in range(n)]))
    done = adjust(state.rig, sightings, _freedom(state, options), start_px)
    rig, points = _in_world(state, done, _fixed(state, options))
    done = replace(done, rig=rig, points_m=points, rows=rows_of(rig, sightings, points, done.scale))
    return replace(state, rig=rig, adjusted=done, sightings=sightings)


def _in_world(state: Progressed, done: Adjusted, fixed: np.ndarray) -> tuple[CameraRig, np.ndarray]:
    if fixed.sum() >= 2:
        return done.rig, done.points_m
    if fixed.any():
        return rescaled(state.before, done.rig, done.points_m, fixed, state.trusted)
    return align(state.before, done.rig, done.points_m, state.trusted)


def _freedom(state: Progressed, options: RefineOptions) -> Freedom:
    """What may change; the lens of a camera located by a board too, where the board was all over its image."""
    fixed = tuple(name for name in options.fix if name in state.rig.names)
    free = Freedom.of(state.rig, options.refine, fixed).free
    assert state.covered is not None
    if options.refine != "extrinsics":
        moving = [v for v, name in enumerate(state.rig.names) if name not in fixed]
        checks.must_cover(state.rig, state.covered, moving)
    for name in state.located:
        v = state.rig.index(name)
        if options.rigid and state.covered[v]:
            free[v] = Freedom.of(state.rig.select([name]), "lens").free[0]
    return Freedom(free)


def _fixed(state: Progressed, options: RefineOptions) -> np.ndarray:
    return np.array([name in options.fix for name in state.rig.names])


def _hopeless(state: Progressed, options: RefineOptions, *, unfit: bool) -> dict[str, str]:
    """Cameras to leave out: name to why; those that fit badly only where ``unfit``: early on many do."""
    assert state.adjusted is not None
    assert state.sightings is not None
    # Who agreed with the others as it was given was not given a wrong pose.
    names, movable = state.rig.names, state.trusted & ~_fixed(state, options)
    movable &= np.array([name in state.doubted for name in names])
    length = np.sqrt(state.adjusted.rows.squared) * state.adjusted.scale[state.sightings.view]
    length = length * state.sightings.sigma_px
    errors = np.array([_median(length[state.sightings.view == v]) for v in range(len(names))])
    why = {
        names[v]: f"adjusted as well as can be, it is still {error:.1f} px off what the others see."
        for v, error in (checks.unfit(state.rig, errors) if unfit else {}).items()
        if not _fixed(state, options)[v]
    }
    given = checks.worthless(state.before, state.sightings, state.adjusted.points_m)
    known = _known(state, options) if given else None
    reach = reach_of(state.rig, state.adjusted.points_m)
    for v, error in given.items():
        # Where the points do not tell how the camera stands they do not tell that it stood wrong either.
        if movable[v] and known is not None and checks.determined(known, v, reach):
            why[names[v]] = (
                f"its pose in the calibration is {error:.0f} px off what the others see, worse than none: it is not "
                f"this camera's. --relocate {names[v]} finds its place from scratch."
            )
    return why


def _same(last: CameraRig, state: Progressed) -> bool:
    """Whether no camera moved by more than a small share of a degree, or as much at the distance of the subject."""
    assert state.adjusted is not None
    moved = pose_changes(last, state.rig)
    reach = reach_of(state.rig, state.adjusted.points_m)
    return bool(np.degrees(max(np.abs(moved[:, :3]).max(), np.abs(moved[:, 3:]).max() / reach)) < _SETTLED)


def _relocated(state: Progressed, given: CameraRig, evidence: Evidence, options: RefineOptions) -> Progressed:
    """The cameras that are to be located from scratch, located by points of the others."""
    gathered = evidence.gather(state.rig)
    sightings = gathered.sightings.keep(gathered.used)
    sightings = sightings.of_points(~held_out(evidence.n_frames)[sightings.frame])
    lens: Refine = "lens" if options.rigid or options.refine == "lens" else options.refine
    source = with_distortion(given) if lens == "lens" else given
    found, failed = [], {}
    for name in options.relocate:
        place = locate(source[name], sightings.points_m, evidence.seen_by(name, sightings), lens, options.seed)
        if place is None or place.agreeing < _AGREES:
            failed[name] = "no place of it agrees with most of the points that the others see."
        else:
            found.append(place.camera)
    if not found:
        raise CalibrationError(
            f"{choices(options.relocate)} cannot be located: at least 20 points that other cameras agree on, and that "
            "do not lie in one plane, must be seen, most of them rightly."
        )
    before = replace(state.before, cameras=(*state.before.cameras, *found))
    rig = replace(state.rig, cameras=(*state.rig.cameras, *found))
    order = [name for name in given.names if name in rig.names]
    names = tuple(camera.name for camera in found)
    return replace(
        state, before=before.select(order), rig=rig.select(order), located=names, left_out={**state.left_out, **failed}
    )
