"""Refine a calibration from the observations of its cameras: triangulate, adjust, and repeat until nothing changes.

In each iteration, detections that contradict other views are rejected, and cameras that cannot be corrected are left
out by name. See docs/calibration.md.
"""

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from posefuse.calibration import checks
from posefuse.calibration.adjust import Adjustment, adjust
from posefuse.calibration.gauge import align, choose_gauge, pose_changes, rescale_about_fixed, typical_distance_m
from posefuse.calibration.locate import locate
from posefuse.calibration.normal_equations import compute_rows
from posefuse.calibration.parameters import FreeParameters, Refine, with_distortion
from posefuse.calibration.point_observations import PointObservations
from posefuse.calibration.selection import held_out_frames, select_spread_points
from posefuse.calibration.uncertainty import Uncertainty, estimate_uncertainty
from posefuse.errors import CalibrationError, choices
from posefuse.model.cameras import CameraRig
from posefuse.model.options.refinement import RefineOptions
from posefuse.progress import Progress

_POINT_SHARES = (0.3, 0.6, 1.0, 1.0)
_MIN_AGREEING_SHARE = 0.5
_MAX_START_SHARE = 0.05
_CONVERGED_DEG = 0.02


@dataclass(frozen=True, eq=False)
class TriangulatedObservations:
    """Hold the observations of a rig, triangulated with it.

    Attributes:
        observations: all observations of points that at least two views observe.
        used: shape (observation,), bool: whether it agrees with the other views.
        error_px: shape (observation,): reprojection error.
    """

    observations: PointObservations
    used: np.ndarray
    error_px: np.ndarray

    def medians(self, n_views: int, chosen: np.ndarray | None = None) -> np.ndarray:
        """Return each view's median error in the chosen frames, shape (view,), NaN without observations."""
        return np.array([_median(each) for each in self._by_view(self.error_px, n_views, chosen)])

    def shares(self, n_views: int, chosen: np.ndarray | None = None) -> np.ndarray:
        """Return each view's share of observations that agree with other views, shape (view,), NaN without any."""
        return np.array([each.mean() if len(each) else np.nan for each in self._by_view(self.used, n_views, chosen)])

    def _by_view(self, values: np.ndarray, n_views: int, chosen: np.ndarray | None) -> list[np.ndarray]:
        observations = self.observations
        kept = np.ones(len(values), dtype=bool) if chosen is None else chosen[observations.frame][observations.point]
        return [values[kept & (observations.view == v)] for v in range(n_views)]


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else float("nan")


class RecordingSource(Protocol):
    """Provide the observations of a recording to a refinement."""

    @property
    def n_frames(self) -> int:
        """Return the number of frames."""
        ...

    def triangulate(self, rig: CameraRig) -> TriangulatedObservations:
        """Triangulate with some cameras."""
        ...

    def pixels_of(self, name: str, observations: PointObservations) -> np.ndarray:
        """Return one more camera's observations of points, shape (point, 2), NaN where there is none."""
        ...


@dataclass(frozen=True, eq=False)
class RefinementState:
    """Hold the state of a refinement.

    Attributes:
        before: original cameras that are not left out; for relocated cameras, the located ones.
        rig: the same cameras as refined so far.
        located: names of the cameras located without an initial pose.
        left_out: name and reason of each camera left out.
        contradicted: names of the cameras that most others contradicted with their original poses.
        covered: shape (view,), bool, of the last iteration: whether a view's observations cover its image.
        adjustment: result of the last iteration.
        observations: its observations.
        first: cameras that were triangulated with first, and the result.
    """

    before: CameraRig
    rig: CameraRig
    located: tuple[str, ...] = ()
    left_out: dict[str, str] = field(default_factory=dict)
    contradicted: tuple[str, ...] = ()
    covered: np.ndarray | None = None
    adjustment: Adjustment | None = None
    observations: PointObservations | None = None
    first: tuple[CameraRig, TriangulatedObservations] | None = None

    def without(self, reasons: dict[str, str]) -> "RefinementState":
        """Return the state without some cameras, given by name and reason."""
        kept = [name for name in self.rig.names if name not in reasons]
        if len(kept) < 2:
            explained = " ".join(f"Camera {name!r}: {why}" for name, why in {**self.left_out, **reasons}.items())
            raise CalibrationError(f"Fewer than two cameras are left to refine. {explained}")
        return replace(
            self, before=self.before.select(kept), rig=self.rig.select(kept), left_out={**self.left_out, **reasons}
        )

    @property
    def trusted(self) -> np.ndarray:
        """Return which cameras have an informative original pose, shape (view,), bool."""
        return np.array([name not in self.located for name in self.rig.names])


def refine(
    given: CameraRig, source: RecordingSource, options: RefineOptions, progress: Progress
) -> tuple[RefinementState, Uncertainty]:
    """Refine the cameras of a rig.

    Args:
        given: the cameras, in the order of the recording's views.
        source: observations of the recording.
        options: which parameters may change.
        progress: receives the progress.

    Returns:
        The final state, and the uncertainty of the refined cameras.

    Raises:
        CalibrationError: if the observations do not determine the cameras.
    """
    kept = [name for name in given.names if name not in options.relocate]
    for name in (*options.fix, *options.relocate):
        given.index(name)
    if len(kept) < 2:
        raise CalibrationError("At least two cameras must keep their poses; the others are located relative to them.")
    rig = with_distortion(given) if options.refine == "lens" else given
    state = RefinementState(rig.select(kept), rig.select(kept))
    progress.start("refining", len(_POINT_SHARES) * (2 if options.relocate else 1))
    state = _iterate(state, source, options, progress)
    if options.relocate:
        state = _locate_cameras(state, given, source, options)
        state = _iterate(state, source, options, progress)
    progress.finish()
    uncertainty = _uncertainty(state, options)
    assert state.adjustment is not None
    checks.require_determined(uncertainty, state.rig, typical_distance_m(state.rig, state.adjustment.points_m))
    return state, uncertainty


def _uncertainty(state: RefinementState, options: RefineOptions) -> Uncertainty:
    """Return the uncertainty of the cameras after an iteration."""
    assert state.adjustment is not None
    assert state.observations is not None
    free, fixed = _free_parameters(state, options), _fixed(state, options)
    gauge = choose_gauge(state.before, state.rig, state.adjustment.points_m, fixed, state.trusted)
    return estimate_uncertainty(state.adjustment, state.observations, free, gauge)


def _iterate(
    state: RefinementState, source: RecordingSource, options: RefineOptions, progress: Progress
) -> RefinementState:
    """Repeat triangulation and adjustment until the cameras converge.

    Every repetition beyond the planned ones leaves out at least one camera, and two remain, so the number is bounded.
    """
    shares = list(_POINT_SHARES)
    while shares:
        share = shares.pop(0)
        state, triangulated = _connected_cameras(state, source)
        previous = state.rig
        state = _adjust_once(state, triangulated, source.n_frames, options, share)
        progress.advance(1)
        reasons = _cameras_to_leave_out(state, options, check_misfits=share == 1.0)
        if reasons:
            # The cameras that remain need an adjustment of their own.
            state, shares = state.without(reasons), shares or [1.0]
        elif share == 1.0 and _has_converged(previous, state):
            break
    return state


def _connected_cameras(
    state: RefinementState, source: RecordingSource
) -> tuple[RefinementState, TriangulatedObservations]:
    """Triangulate, and leave out cameras that are copies of others or share too few points."""
    while True:
        triangulated = source.triangulate(state.rig)
        state = replace(state, first=state.first or (state.rig, triangulated))
        n, names = len(state.rig), state.rig.names
        copy = checks.find_copy(state.rig, np.nan_to_num(triangulated.shares(n)))
        if copy is not None:
            a, b = names[copy[0]], names[copy[1]]
            state = state.without(
                {a: f"its pose is a copy of the pose of camera {b!r} and fits the other views worse."}
            )
            continue
        checks.require_enough_points(triangulated.observations)
        disconnected = checks.find_disconnected(triangulated.observations, n)
        if not disconnected:
            return state, triangulated
        reasons = {
            names[v]: f"it shares at most {shared} points with any other camera; {checks.MIN_SHARED_POINTS} are needed."
            for v, shared in disconnected.items()
        }
        state = state.without(reasons)


def _adjust_once(
    state: RefinementState, triangulated: TriangulatedObservations, n_frames: int, options: RefineOptions, share: float
) -> RefinementState:
    """Run one adjustment, and align its result with the original cameras."""
    n = len(state.rig)
    # If most views contradict a camera, its pose is wrong, and all its observations are used; otherwise agreeing ones.
    contradicted = np.nan_to_num(triangulated.shares(n)) < _MIN_AGREEING_SHARE
    all_observations, error = triangulated.observations, triangulated.error_px
    if state.adjustment is None:
        state = replace(
            state, contradicted=tuple(name for name, off in zip(state.rig.names, contradicted, strict=True) if off)
        )
    kept = (triangulated.used | contradicted[all_observations.view]) & ~held_out_frames(n_frames)[
        all_observations.frame
    ][all_observations.point]
    medians = np.array([_median(error[kept & (all_observations.view == v)]) for v in range(n)])
    observations = all_observations.select(kept)
    observations = observations.select_points(select_spread_points(observations, n, int(share * options.max_points)))
    checks.require_enough_points(observations)
    side = max(max(camera.size_px) for camera in state.rig.cameras)
    start_px = min(float(np.nanmax(medians)), _MAX_START_SHARE * side)
    state = replace(state, covered=np.array([checks.covers(state.rig, all_observations, v) for v in range(n)]))
    adjustment = adjust(state.rig, observations, _free_parameters(state, options), start_px)
    rig, points = _in_original_world(state, adjustment, _fixed(state, options))
    adjustment = replace(
        adjustment, rig=rig, points_m=points, rows=compute_rows(rig, observations, points, adjustment.scale)
    )
    return replace(state, rig=rig, adjustment=adjustment, observations=observations)


def _in_original_world(
    state: RefinementState, adjustment: Adjustment, fixed: np.ndarray
) -> tuple[CameraRig, np.ndarray]:
    """Return the adjusted cameras and points in the world of the original cameras."""
    if fixed.sum() >= 2:
        return adjustment.rig, adjustment.points_m
    if fixed.any():
        return rescale_about_fixed(state.before, adjustment.rig, adjustment.points_m, fixed, state.trusted)
    return align(state.before, adjustment.rig, adjustment.points_m, state.trusted)


def _free_parameters(state: RefinementState, options: RefineOptions) -> FreeParameters:
    """Return the free parameters; the lens of a camera located by a board is free if the board covered its image."""
    fixed = tuple(name for name in options.fix if name in state.rig.names)
    free = FreeParameters.of(state.rig, options.refine, fixed).free
    assert state.covered is not None
    if options.refine != "extrinsics":
        moving = [v for v, name in enumerate(state.rig.names) if name not in fixed]
        checks.require_coverage(state.rig, state.covered, moving)
    for name in state.located:
        v = state.rig.index(name)
        if options.rigid and state.covered[v]:
            free[v] = FreeParameters.of(state.rig.select([name]), "lens").free[0]
    return FreeParameters(free)


def _fixed(state: RefinementState, options: RefineOptions) -> np.ndarray:
    """Return which cameras are fixed, shape (view,), bool."""
    return np.array([name in options.fix for name in state.rig.names])


def _cameras_to_leave_out(state: RefinementState, options: RefineOptions, *, check_misfits: bool) -> dict[str, str]:
    """Return name and reason of cameras to leave out.

    Misfits are included only if ``check_misfits``, since many cameras fit badly in the first iterations.
    """
    assert state.adjustment is not None
    assert state.observations is not None
    # A camera that agreed with the others originally did not have a wrong pose.
    names, movable = state.rig.names, state.trusted & ~_fixed(state, options)
    movable &= np.array([name in state.contradicted for name in names])
    length = np.sqrt(state.adjustment.rows.squared) * state.adjustment.scale[state.observations.view]
    length = length * state.observations.sigma_px
    errors = np.array([_median(length[state.observations.view == v]) for v in range(len(names))])
    reasons = {
        names[v]: f"its reprojection error is still {error:.1f} px after the adjustment."
        for v, error in (checks.find_misfits(state.rig, errors) if check_misfits else {}).items()
        if not _fixed(state, options)[v]
    }
    given = checks.find_useless_poses(state.before, state.observations, state.adjustment.points_m)
    uncertainty = _uncertainty(state, options) if given else None
    distance_m = typical_distance_m(state.rig, state.adjustment.points_m)
    for v, error in given.items():
        # If the points do not determine the camera, they do not prove that its pose was wrong either.
        if movable[v] and uncertainty is not None and checks.is_determined(uncertainty, v, distance_m):
            reasons[names[v]] = (
                f"its calibrated pose has a reprojection error of {error:.0f} px, worse than without an initial pose; "
                f"the pose probably belongs to another camera. Use `relocate={[names[v]]!r}` to estimate it without an "
                "initial pose."
            )
    return reasons


def _has_converged(previous: CameraRig, state: RefinementState) -> bool:
    """Return whether no camera moved by more than a small fraction of a degree, or as much at the typical distance."""
    assert state.adjustment is not None
    change = pose_changes(previous, state.rig)
    distance_m = typical_distance_m(state.rig, state.adjustment.points_m)
    return bool(np.degrees(max(np.abs(change[:, :3]).max(), np.abs(change[:, 3:]).max() / distance_m)) < _CONVERGED_DEG)


def _locate_cameras(
    state: RefinementState, given: CameraRig, source: RecordingSource, options: RefineOptions
) -> RefinementState:
    """Locate the cameras without usable poses by points of the others."""
    triangulated = source.triangulate(state.rig)
    observations = triangulated.observations.select(triangulated.used)
    observations = observations.select_points(~held_out_frames(source.n_frames)[observations.frame])
    lens: Refine = "lens" if options.rigid or options.refine == "lens" else options.refine
    rig_with_lens = with_distortion(given) if lens == "lens" else given
    found, failed = [], {}
    for name in options.relocate:
        located = locate(
            rig_with_lens[name], observations.points_m, source.pixels_of(name, observations), lens, options.seed
        )
        if located is None or located.agreeing < _MIN_AGREEING_SHARE:
            failed[name] = "no pose agrees with most of the points of the other cameras."
        else:
            found.append(located.camera)
    if not found:
        raise CalibrationError(
            f"Cannot estimate the pose of {choices(options.relocate)}. This requires at least 20 noncoplanar points "
            "that other cameras agree on and that this camera observes mostly without outliers."
        )
    before = replace(state.before, cameras=(*state.before.cameras, *found))
    rig = replace(state.rig, cameras=(*state.rig.cameras, *found))
    order = [name for name in given.names if name in rig.names]
    names = tuple(camera.name for camera in found)
    return replace(
        state, before=before.select(order), rig=rig.select(order), located=names, left_out={**state.left_out, **failed}
    )
