"""Refine a calibration from the triangulated detections of a recording."""

import warnings
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import ranges
from posefuse.calibration.checks import pose_sds
from posefuse.calibration.gauge import pose_changes
from posefuse.calibration.outcome import CameraOutcome, Refinement, Role
from posefuse.calibration.point_observations import PointObservations
from posefuse.calibration.refine import RefinementState, TriangulatedObservations, refine
from posefuse.calibration.selection import held_out_frames
from posefuse.calibration.uncertainty import Uncertainty
from posefuse.errors import CalibrationError, PosefuseWarning, choices
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import CHUNK_FRAMES, Detections
from posefuse.model.options.options import Options
from posefuse.model.options.postprocess import PostprocessOptions
from posefuse.model.options.refinement import RefineOptions
from posefuse.model.options.sync import SyncOptions
from posefuse.model.status import ViewStatus
from posefuse.pipeline.defaults import RecordingFacts, cut_time, resolve_people
from posefuse.pipeline.measured_layer import measure
from posefuse.pipeline.people.find_subjects import find_subjects
from posefuse.pipeline.plan import Plan
from posefuse.pipeline.reconstruct import examine
from posefuse.preprocess.match_cameras import match_views
from posefuse.preprocess.time_offsets import interpolate_to_frame_times, shift_views
from posefuse.progress import Progress, Silent

_MAX_KEYPOINTS = 60_000
_MIN_FRAMES = 300


@dataclass(frozen=True, eq=False)
class RecordingSource:
    """The observations of a recording; implements the protocol of :mod:`posefuse.calibration.refine`.

    Attributes:
        detections: detections of all views with a camera, in the frames used.
        options: options of triangulation.
    """

    detections: Detections
    options: Options

    @property
    def n_frames(self) -> int:
        """Number of frames used."""
        return self.detections.n_frames

    def triangulate(self, rig: CameraRig) -> TriangulatedObservations:
        """Triangulate with some cameras, using left and right labels as they are and rejecting outliers."""
        options = replace(self.options, cameras=rig.names, exclude_camera=(), camera_order=())
        with warnings.catch_warnings():
            # Views that disagree are expected before the refinement.
            warnings.simplefilter("ignore", PosefuseWarning)
            plan = examine(rig, self.detections.views(rig.names), options, Silent())
            parts = [_observations(plan, *span) for span in ranges(self.n_frames, CHUNK_FRAMES)]
        return _concatenate(parts)

    def pixels_of(self, name: str, observations: PointObservations) -> np.ndarray:
        """Return another camera's pixels of points, shape (point, 2), NaN where it has none.

        Raises:
            CalibrationError: if the view shows several people, who cannot be assigned without a pose.
        """
        if self.several:
            raise CalibrationError(
                f"Camera {name!r} has no pose and cannot be located from keypoints of several people, because people "
                "cannot be associated before the pose is known. Use a part of the recording with one person "
                "(`start_s`, `end_s`), or a board (`rigid=True`)."
            )
        one = self.detections.views([name])
        pixels = np.full((self.n_frames, len(one.skeleton), 2), np.nan)
        pixels[one.people_counts[:, 0] == 1] = np.asarray(one.keypoints_px)[
            one.offsets[:-1][one.people_counts[:, 0] == 1]
        ]
        return pixels[observations.frame, observations.keypoint % len(one.skeleton)]

    @cached_property
    def several(self) -> bool:
        """Whether a view shows several people."""
        return bool((self.detections.people_counts > 1).any())


def _observations(plan: Plan, start: int, stop: int) -> TriangulatedObservations:
    """Return the observations of a range of frames."""
    result = measure(plan, start, stop)
    layer, detections = result.layers["measured"], plan.detections.frames(start, stop)
    points, status = np.asarray(layer.points_m), np.asarray(layer.view_status)
    assert result.tracks is not None
    rows = result.tracks.rows(detections)
    n_keypoints = points.shape[2]
    present = rows >= 0
    shape = (*rows.shape, n_keypoints)
    pixels = np.full((*shape, 2), np.nan)
    confidence = np.full(shape, np.nan)
    pixels[present] = np.asarray(detections.keypoints_px)[rows[present]]
    confidence[present] = np.asarray(detections.confidence)[rows[present]]
    # (frame, person, keypoint, view)
    pixels, confidence = np.moveaxis(pixels, 2, 3), np.moveaxis(confidence, 2, 3)
    projected = np.moveaxis(plan.rig.project(points), 1, 3)
    error = np.linalg.norm(projected - pixels, axis=-1)
    seen = np.isfinite(error) & ~(confidence < plan.options.triangulation.min_confidence)
    seen &= seen.sum(axis=-1, keepdims=True) >= 2
    chosen = seen.any(axis=-1)
    frame, person, keypoint = np.nonzero(chosen)
    point, view = np.nonzero(seen[chosen])
    at = (frame[point], person[point], keypoint[point], view)
    noise = plan.noise
    sigma = (
        noise.scale_px[view]
        / np.maximum(np.where(np.isnan(confidence[at]), 1.0, confidence[at]), 0.05) ** noise.exponent
    )
    observations = PointObservations(
        view, point, pixels[at], sigma, points[chosen], frame + start, person * n_keypoints + keypoint
    )
    return TriangulatedObservations(observations, status[at] == ViewStatus.USED, error[at])


def _concatenate(parts: list[TriangulatedObservations]) -> TriangulatedObservations:
    """Concatenate the observations of consecutive ranges of frames."""
    observations = [part.observations for part in parts]
    first = np.cumsum([0] + [each.n_points for each in observations[:-1]])
    return TriangulatedObservations(
        PointObservations(
            np.concatenate([each.view for each in observations]),
            np.concatenate([each.point + start for each, start in zip(observations, first, strict=True)]),
            np.concatenate([each.pixels for each in observations]),
            np.concatenate([each.sigma_px for each in observations]),
            np.concatenate([each.points_m for each in observations]),
            np.concatenate([each.frame for each in observations]),
            np.concatenate([each.keypoint for each in observations]),
        ),
        np.concatenate([part.used for part in parts]),
        np.concatenate([part.error_px for part in parts]),
    )


@checked
def refine_calibration(
    rig: CameraRig,
    detections: Detections,
    options: Options | None = None,
    refining: RefineOptions | None = None,
    *,
    progress: Progress | None = None,
) -> Refinement:
    """Refine a calibration from a recording, see docs/calibration.md.

    Args:
        rig: calibrated cameras.
        detections: 2D keypoints of a recording, or the corners of a board.
        options: views and frames to use, and options of triangulation.
        refining: parameters to refine.
        progress: receives the progress.

    Returns:
        The refined cameras in the world of the original ones, and the change and uncertainty of each.

    Raises:
        CalibrationError: if the observations do not determine the cameras.
        MatchError: if views and cameras do not match.
    """
    options = replace(
        options or Options(), solve="frame", postprocess=PostprocessOptions(), pairs="labels", bodies="none"
    )
    refining = refining or RefineOptions()
    progress = progress or Silent()
    matched, detections, _ = match_views(rig, detections, options)
    detections = replace(detections, view_names=matched.names)
    detections = cut_time(detections, options)
    options = replace(options, start_s=None, end_s=None)
    if len(matched) < 2:
        raise CalibrationError(f"The rig has one camera, {choices(matched.names)}; a refinement needs two or more.")
    detections, options = _synchronized(matched, detections, options, progress)
    source = RecordingSource(_sample_frames(detections, options), options)
    state, known = refine(matched, source, refining, progress)
    return _outcome(matched, source, refining, state, known)


def _synchronized(
    rig: CameraRig, detections: Detections, options: Options, progress: Progress
) -> tuple[Detections, Options]:
    """Return the detections at the frame times, before frames are sampled, and options without time offsets."""
    if options.sync.does_nothing:
        return detections, options
    shifted = shift_views(detections, rig.names, options.sync)
    options = replace(options, sync=SyncOptions())
    resolved = resolve_people(options, RecordingFacts.of(shifted.detections), len(rig))
    subjects, _ = find_subjects(rig, shifted.detections, resolved, progress)
    return interpolate_to_frame_times(shifted, subjects), options


def _sample_frames(detections: Detections, options: Options) -> Detections:
    """Return frames evenly spread over the recording, or all frames of people who must be tracked."""
    several = options.people != "one" and options.pick is None and bool((detections.people_counts > 1).any())
    most = max(_MAX_KEYPOINTS // len(detections.skeleton), _MIN_FRAMES)
    if several or detections.n_frames <= most:
        return detections
    frames = np.linspace(0, detections.n_frames - 1, most).astype(int)
    return detections.pieces([(int(f), int(f) + 1) for f in frames])


def _outcome(
    matched: CameraRig, source: RecordingSource, refining: RefineOptions, state: RefinementState, known: Uncertainty
) -> Refinement:
    """Return the refinement, evaluated on the frames held out."""
    held_out = held_out_frames(source.n_frames)
    kept = state.rig.names
    assert state.first is not None
    rig, old = state.first
    if rig.cameras != matched.cameras:
        old = source.triangulate(matched)
    new = source.triangulate(state.rig)
    n_old, n = len(matched), len(kept)
    before_px, before_used = old.medians(n_old, held_out), old.shares(n_old, held_out)
    after_px, after_used = new.medians(n, held_out), new.shares(n, held_out)
    moved = pose_changes(matched.select(kept), state.rig)
    rows = []
    for u, camera in enumerate(matched.cameras):
        name = camera.name
        if name not in kept:
            rows.append(_left_out(name, state, before_px[u], before_used[u]))
            continue
        v = state.rig.index(name)
        turn_sd, shift_sd, focal_sd = pose_sds(known.block(v))
        rows.append(
            CameraOutcome(
                name, _role(name, refining, state), "", before_px[u], after_px[v], before_used[u], after_used[v],
                float(np.degrees(np.linalg.norm(moved[v, :3]))), turn_sd, float(np.linalg.norm(moved[v, 3:])), shift_sd,
                float(state.rig[name].matrix[0, 0] / camera.matrix[0, 0] - 1.0), focal_sd,
            )
        )  # fmt: skip
    assert state.observations is not None
    return Refinement(
        before=matched,
        rig=state.rig,
        cameras=tuple(rows),
        refine=refining.refine,
        n_points=state.observations.n_points,
        n_frames=len(np.unique(state.observations.frame)),
        n_held_out=int(held_out.sum()),
        before_px=_median_of(old, held_out),
        after_px=_median_of(new, held_out),
        gain_z=_gain_z(old, new, held_out),
    )


def _gain_z(old: TriangulatedObservations, new: TriangulatedObservations, held_out: np.ndarray) -> float:
    """Return the mean decrease of the error over the periods held out, in units of its standard deviation."""
    starts = np.flatnonzero(held_out & ~np.concatenate([[False], held_out[:-1]]))
    period = np.searchsorted(starts, np.arange(len(held_out)), side="right")
    decrease = []
    for number in range(1, len(starts) + 1):
        chosen = held_out & (period == number)
        decrease.append(_median_of(old, chosen) - _median_of(new, chosen))
    known = np.array(decrease)[np.isfinite(decrease)]
    if len(known) < 2:
        return float("nan")
    return float(known.mean() / max(known.std(ddof=1) / np.sqrt(len(known)), 1e-12))


def _median_of(triangulated: TriangulatedObservations, held_out: np.ndarray) -> float:
    seen = triangulated.observations
    errors = triangulated.error_px[held_out[seen.frame][seen.point]]
    return float(np.median(errors)) if len(errors) else float("nan")


def _role(name: str, refining: RefineOptions, state: RefinementState) -> Role:
    if name in state.located:
        return "located"
    return "fixed" if name in refining.fix else "refined"


def _left_out(name: str, state: RefinementState, before_px: float, used: float) -> CameraOutcome:
    nan = float("nan")
    why = state.left_out.get(name, "")
    return CameraOutcome(name, "left out", why, before_px, nan, used, nan, nan, nan, nan, nan, nan, nan)
