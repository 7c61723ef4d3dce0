"""The recipe: from a rig and detections to a reconstruction, wired from the stages. Reads top to bottom."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from platform import python_version

import numpy as np

from posefuse.alignment.apply import combine_with_scale, scaled_layer, scaled_rig, identity_alignment
from posefuse.alignment.world_axes import find_alignment
from posefuse.alignment.size import scale_factor
from posefuse.arrays import ranges
from posefuse.association import one_subject
from posefuse.association.one_subject import SingleSubject
from posefuse.checkpoint import NO_CHECKPOINT, Checkpoint
from posefuse.errors import DetectionsError, OptionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.concatenate import gathered
from posefuse.model.detections import CHUNK_FRAMES, Detections
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.options.postprocess import PostprocessOptions
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.reconstruction import Layer, Provenance, Reconstruction
from posefuse.model.subjects import Subjects
from posefuse.noise import scale as noise_scale
from posefuse.noise import survey
from posefuse.pipeline import people, solved_layer
from posefuse.pipeline.defaults import (
    cut_time,
    settle_chunks,
    settle_method,
    settle_min_views,
    settle_pairs,
    settle_people,
    settle_solve,
)
from posefuse.pipeline.measured_layer import Plan, measure, partial_note, reconstruct_chunks
from posefuse.pipeline.people import TrackedPeople
from posefuse.pipeline.solved_layer import Postprocess, Solver, Step
from posefuse.postprocess.bones import median_bones
from posefuse.preprocess import time_offsets
from posefuse.preprocess.match_cameras import match_views
from posefuse.preprocess.timeline import align_views
from posefuse.preprocess.weights import weighed
from posefuse.progress import Progress, Silent
from posefuse.skeleton.skeletons import Skeleton, find_skeleton
from posefuse.tracking.records import People


def reconstruct(
    rig: CameraRig,
    detections: Detections,
    options: Options | None = None,
    *,
    progress: Progress | None = None,
    checkpoint: Checkpoint = NO_CHECKPOINT,
) -> Reconstruction:
    """Reconstruct people in 3D from calibrated views.

    Args:
        rig: calibrated cameras. Views find their cameras by name; see :func:`match_views`.
        detections: 2D keypoints.
        options: what to do; the defaults suit one person.
        progress: told how far the work is.
        checkpoint: keeps finished parts of long work (:class:`posefuse.io.checkpoints.CheckpointFolder`), from which the same call goes on
            after it was ended.

    Returns:
        The reconstruction, in memory.

    Raises:
        MatchError: if views and cameras do not belong together.
        DetectionsError: if the detections do not allow what the options ask for.
    """
    plan = prepare(rig, detections, options or Options(), progress or Silent(), checkpoint)
    return gathered(reconstruct_chunks(plan, progress or Silent(), checkpoint), plan.detections.n_frames)


def triangulate(rig: CameraRig, detections: Detections, options: Options | None = None) -> Reconstruction:
    """Only measure: the ``measured`` layer of :func:`reconstruct`, nothing filled, smoothed or modelled.

    Arguments, result and errors are those of :func:`reconstruct`.
    """
    options = replace(options or Options(), solve="frame", postprocess=PostprocessOptions())
    plan = prepare(rig, detections, options, Silent())
    return measure(plan, 0, plan.detections.n_frames)


def prepare(
    rig: CameraRig,
    detections: Detections,
    options: Options,
    progress: Progress,
    checkpoint: Checkpoint = NO_CHECKPOINT,
    who: "Who | None" = None,
) -> Plan:
    """Settle everything that needs the whole recording: views, frames, subjects, noise, method, world, solver.

    Args:
        rig: calibrated cameras.
        detections: 2D keypoints.
        options: what to do.
        progress: told how far the work is.
        checkpoint: keeps what was followed of a long recording. If it does, the plan of a recording whose following is
            interrupted is of the frames that were followed.
        who: finds whose detections are whose, by default :func:`who_is_followed`.
    """
    examined, sample = look(rig, detections, options, progress, who or partial(who_is_followed, checkpoint=checkpoint))
    plan, scale = settle(examined), None
    if options.align.scales:
        scale = scale_factor(points_of(sampled(plan)), detections.skeleton, options.align)
        again = checkpoint.child(f"resized_{examined.detections.n_frames}")
        who = who or partial(who_is_followed, checkpoint=again)
        plan, sample = resized(examined, plan, sample, scale, progress, who)
    return settle_solver(settle_world(with_findings(plan, sample), scale))


def resized(
    examined: Plan, plan: Plan, sample: Layer | None, scale: float, progress: Progress, who: "Who"
) -> tuple[Plan, Layer | None]:
    """A plan and what was measured for it, in a world of another size.

    What one subject's detections say of each other does not depend on the size of the world. Who is whose does, where
    people are followed: as bodies, with the speeds and lengths of bodies.

    Args:
        examined: before it was settled.
        plan: settled.
        sample: of its points.
        scale: what lengths are multiplied by.
        progress: told how far the work is.
        who: finds whose detections are whose.
    """
    rig = scaled_rig(plan.rig, scale)
    if plan.bodies is None and isinstance(plan.subjects, SingleSubject):
        return replace(plan, rig=rig), None if sample is None else scaled_layer(sample, scale)
    subjects, bodies = who(rig, examined.detections, examined.options, progress)
    detections, notes = as_far_as_followed(examined.detections, bodies or subjects)
    noise, sample = survey.survey(rig, detections, examined.options, subjects, progress)
    provenance = examined.provenance.with_notes(notes)
    examined = replace(examined, rig=rig, detections=detections, provenance=provenance)
    return settle(replace(examined, subjects=subjects, bodies=bodies, noise=noise)), sample


def with_findings(plan: Plan, sample: Layer | None) -> Plan:
    """The plan with a warning and a note of everything that a sample of its points shows to be wrong."""
    if sample is None:
        return plan
    said = survey.findings(plan.rig, sample, plan.noise, plan.detections.skeleton)
    return replace(plan, provenance=plan.provenance.with_notes(said))


def settle_world(plan: Plan, scale: float | None) -> Plan:
    """Find the world that the options ask for, and say how.

    Args:
        plan: what is settled, in a world of the right size.
        scale: what its lengths were multiplied by, or None if nothing was said of that.

    Raises:
        DetectionsError: if people do not show what is asked for.
        OptionsError: if nothing tells which way is up.
    """
    wanted = plan.options.align
    if not (wanted.turns or wanted.scales):
        return plan
    if len(plan.rig) == 1:
        raise OptionsError("align: one camera shows its image plane, which is no place in the world to align.")
    alignment = identity_alignment(plan.rig.up_axis)
    if wanted.turns:
        alignment = find_alignment(points_of(sampled(plan)), plan.detections.skeleton, plan.rig, wanted)
    if scale is not None:
        alignment = combine_with_scale(alignment, scale, wanted)
    return replace(plan, alignment=alignment, provenance=plan.provenance.with_notes(alignment.steps))


def examine(rig: CameraRig, detections: Detections, options: Options, progress: Progress) -> Plan:
    """Settle what does not depend on the method: views, frames, who the subject is, and the noise.

    Returns:
        A plan that :func:`settle` has to complete before anything is measured.
    """
    return with_findings(*look(rig, detections, options, progress))


def look(
    rig: CameraRig, detections: Detections, options: Options, progress: Progress, who: "Who | None" = None
) -> tuple[Plan, Layer | None]:
    """What :func:`examine` settles, before anything is said of it; and a sample of points, None with one camera."""
    if detections.n_frames == 0:
        raise DetectionsError("The recording is empty: it has no frames.")
    if options.rate_hz is not None and detections.rate_hz is None:
        detections = detections.with_rate(options.rate_hz)
    detections = align_views(detections, options.reference_view)
    rig, detections, notes = match_views(rig, detections, options)
    detections = cut_time(detections, options)
    options = settle_chunks(settle_people(options, detections, len(rig)), detections)
    step = None if options.sync.does_nothing else time_offsets.in_step(detections, rig.names, options.sync)
    if step is not None:
        detections, notes = step.detections, (*notes, *step.notes)
    options, detections, own = own_noise(rig, detections, options)
    subjects, bodies = (who or who_is_followed)(rig, detections, options, progress)
    detections, cut = as_far_as_followed(detections, bodies or subjects)
    if step is not None:
        n = detections.n_frames
        step = replace(step, detections=detections, time_s=step.time_s[:n])
        detections = time_offsets.at_frame_times(step, subjects.tracks(0, n))
    if options.people == "one":
        notes = (*notes, *one_subject.remarks(detections, options.pick))
    noise, sample = survey.survey(rig, detections, options, subjects, progress)
    provenance = Provenance(
        versions={"posefuse": version("posefuse"), "numpy": np.__version__, "python": python_version()},
        notes=(*cut, *rig.notes, *detections.notes, *notes, *own),
    )
    return Plan(rig, detections, options, subjects, bodies, noise, provenance), sample


def as_far_as_followed(detections: Detections, known: Subjects) -> tuple[Detections, tuple[str, ...]]:
    """The frames through which people were followed, and what is to be said if those are not all."""
    n_frames = detections.n_frames
    if not isinstance(known, TrackedPeople) or known.n_frames == n_frames:
        return detections, ()
    return detections.between(0, known.n_frames), (partial_note(known.n_frames, n_frames),)


def own_noise(rig: CameraRig, detections: Detections, options: Options) -> tuple[Options, Detections, tuple[str, ...]]:
    """Weigh detections by the standard deviations that they come with, unless the options fix the noise."""
    if detections.sigma_px is None:
        return options, detections, ()
    if survey.known_noise(rig, options) is not None:
        note = "The options fix the noise: the standard deviations that the detections come with are not used."
        return options, replace(detections, sigma_px=None), (note,)
    usual_px = float(np.median(noise_scale.assumed(rig, 1.0).scale_px))
    found = weighed(detections, usual_px, options.triangulation.min_confidence)
    if found is None:
        return options, replace(detections, sigma_px=None), ()
    note = (
        "Detections are weighed by the standard deviations that they come with; their common scale is the recording's. "
        "--noise-scale-px takes all alike."
    )
    return replace(options, triangulation=replace(options.triangulation, confidence_exponent=1.0)), found, (note,)


def who_is_followed(
    rig: CameraRig, detections: Detections, options: Options, progress: Progress, checkpoint: Checkpoint = NO_CHECKPOINT
) -> tuple[Subjects, TrackedPeople | None]:
    """Whose detections are whose, and their bodies if any are fitted.

    Args:
        rig: the cameras.
        detections: of the recording.
        options: of its reconstruction.
        progress: told how far the work is.
        checkpoint: keeps what was followed.

    Raises:
        DetectionsError: if one subject is asked for and nobody said which, or frames of many have no times.
        OptionsError: if the options keep somebody who is not there.
        SkeletonError: if bodies are asked for and nothing tells how they move.
    """
    if options.people == "many" or options.bodies == "fit":
        people.warn_of_unused_options(options, detections.skeleton)
    if options.people == "many":
        many = people.track_people(rig, detections, options, progress, checkpoint)
        many = many.only(options.person) if options.person else many
        return many, None if options.bodies == "none" else many
    subject = SingleSubject.of(detections, options.pick)
    if options.bodies != "fit":
        return subject, None
    if len(rig) == 1:
        raise OptionsError("bodies = 'fit' needs two cameras or more; this rig has one.")
    followed = people.track_subject(rig, detections, subject, options, progress, checkpoint)
    if not followed.recording_tracks.person_ids:
        raise DetectionsError(
            "bodies = 'fit' found no frame in which two cameras show the subject well enough to begin. Look at the "
            "measured points first (bodies = 'auto')."
        )
    return subject, followed


Who = Callable[[CameraRig, Detections, Options, Progress], tuple[Subjects, TrackedPeople | None]]
"""Finds whose detections are whose, and bodies if any are fitted, as :func:`who_is_followed` does."""


def settle(plan: Plan, method: str | None = None) -> Plan:
    """Settle what depends on the method: how many views a point needs, and what it has to see the recording for.

    Args:
        plan: what was examined.
        method: another than the options name.
    """
    options = plan.options
    if method is not None:
        options = replace(options, triangulation=replace(options.triangulation, method=method))
    options = settle_pairs(options, len(plan.rig), plan.detections.skeleton)
    options, warning = settle_min_views(options, len(plan.rig))
    options, remarks = settle_method(plan.rig, plan.detections, options, plan.subjects, plan.noise)
    notes = (*plan.provenance.notes, *warning, *remarks)
    return replace(plan, options=options, provenance=replace(plan.provenance, notes=notes), solver=None, alignment=None)


def settle_solver(plan: Plan) -> Plan:
    """Settle how points are solved over time, if they are, and learn from a sample what that takes.

    Raises:
        DetectionsError: if that takes times and frames have none.
        OptionsError: if a filter cannot be had at this frame rate.
    """
    plan = replace(plan, options=settle_solve(plan.options, plan.detections, len(plan.rig)))
    wanted = plan.options.postprocess
    steps: list[Step] = []
    # In ranges: of a long recording in a file no more than one is read at a time.
    pieces = ranges(plan.detections.n_frames, CHUNK_FRAMES)
    state = np.concatenate([np.asarray(plan.subjects.tracks(*piece).state) for piece in pieces])
    if plan.options.solve == "trajectory" and state.shape[1]:
        spans = solved_layer.telling_spans(state)
        measured = partial(measure, plan)
        steps.append(
            solved_layer.learned(plan.rig, plan.detections, plan.noise, spans, measured, plan.options.trajectory)
        )
    if not wanted.does_nothing:
        bones = median_bones(points_of(sampled(plan)), plan.detections.skeleton) if wanted.rigid_bones else None
        steps.append(Postprocess.of(plan.rig, plan.detections, plan.options, bones))
    if not steps:
        return plan
    return replace(plan, solver=Solver(tuple(steps), solved_layer.clock_of(plan.detections).period_s))


def sampled(plan: Plan) -> Iterator[Reconstruction]:
    """Measured ranges of frames that represent the recording: all of a short one, pieces of a long one."""
    return (measure(plan, *span) for span in noise_scale.spans(plan.detections))


def points_of(parts: Iterable[Reconstruction]) -> list[np.ndarray]:
    """The measured points of ranges of frames, each of shape (frame, person, keypoint, 3)."""
    return [np.asarray(part.layers["measured"].points_m) for part in parts]


class Tracker:
    """Follows people live: one frame in, everybody known out; nothing is kept outside it.

    It can be pickled between frames. The same frames give the same people.

    Args:
        rig: calibrated cameras, in the order of the frames' views.
        skeleton: of the keypoints; its tree says how bodies move.
        options: ``tracker``, ``association``, ``triangulation.confidence_exponent`` and what fixes the noise count;
            without that, detections are taken to err by 4.5 px / confidence at 1000 px image width.

    Raises:
        SkeletonError: if the skeleton has no tree.
    """

    def __init__(self, rig: CameraRig, skeleton: Skeleton | str, options: Options | None = None) -> None:
        options = options or Options()
        noise, known = people.default_noise(rig, options), find_skeleton(skeleton)
        # Nothing is smoothed live, whatever the options say of it.
        live = replace(options, tracker=replace(options.tracker, smoother="none", lag_s=TrackerOptions().lag_s))
        people.warn_of_unused_options(live, known)
        self._tracker = people.tracker_of(rig, known, noise, options)

    def update(self, frame: Frame) -> People:
        """Take a frame, later than the last.

        Args:
            frame: what the views show; :meth:`Frame.of_people` makes one from detectors' arrays.

        Returns:
            Everybody: active, then lost, then tentative people, with positions in metres, covariances, whose detection
            is whose, and what happened.

        Raises:
            DetectionsError: if the frame does not fit the cameras or the skeleton, has no time, or is not later.
        """
        return self._tracker.update(frame)


def calibrate_noise(
    rig: CameraRig, detections: Detections, options: Options | None = None, *, progress: Progress | None = None
) -> NoiseModel:
    """The law of a recording's detection errors, by leaving views out; see docs/methods.md, "Calibrating the noise".

    Args:
        rig: calibrated cameras.
        detections: 2D keypoints, with confidences if errors are to fall with them.
        options: as of :func:`reconstruct`; what they say of the noise does not count.
        progress: told how far the work is.

    Returns:
        Each camera's scale, the exponent of the confidence, the spread of accepted errors, and the tails.

    Raises:
        MatchError: if views and cameras do not belong together.
        DetectionsError: if too few points are seen by three views that agree.
    """
    options = options or Options()
    rig, detections, _ = match_views(rig, detections, options)
    detections = cut_time(detections, options)
    return survey.find_law(rig, detections, options, SingleSubject.of(detections, options.pick), progress or Silent())
