"""The recipe of a reconstruction: from a rig and detections to a plan and its result."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache, partial
from importlib.metadata import version
from platform import python_version

import numpy as np

from posefuse.alignment.apply import combine_with_scale, identity_alignment, scaled_layer, scaled_rig
from posefuse.alignment.infer_up import describe_up, infer_up
from posefuse.alignment.size import scale_factor
from posefuse.alignment.world_axes import find_alignment
from posefuse.arguments import checked
from posefuse.arrays import ranges
from posefuse.association.one_subject import SingleSubject, lone_detections
from posefuse.checkpoint import NO_CHECKPOINT, Checkpoint
from posefuse.diagnostics.sample_findings import sample_findings
from posefuse.diagnostics.view_shifts import shift_note
from posefuse.errors import DetectionsError, OptionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.concatenate import concatenate_ranges
from posefuse.model.detections import CHUNK_FRAMES, Detections
from posefuse.model.options.options import Options
from posefuse.model.options.postprocess import PostprocessOptions
from posefuse.model.reconstruction import Layer, Provenance, Reconstruction
from posefuse.model.tracks import Tracks
from posefuse.noise.estimate import estimate_noise
from posefuse.noise.fixed import fixed_noise
from posefuse.noise.samples import Samples, sample_spans, take_samples
from posefuse.noise.scales import assumed_noise
from posefuse.parallel import ONE_JOB, JobCount, Jobs, number_of_jobs
from posefuse.pipeline import solved_layer, trajectory_fit
from posefuse.pipeline.defaults import RecordingFacts, cut_time, resolve_method, resolve_options
from posefuse.pipeline.diagnose import begin_check
from posefuse.pipeline.joint_angles import with_joint_angles
from posefuse.pipeline.left_out_views import with_layer_scores
from posefuse.pipeline.measured_layer import MeasuredRanges, measure, partial_note, reconstruct_chunks
from posefuse.pipeline.people.find_subjects import (
    FindStoredSubjects,
    FindSubjects,
    find_subjects,
    frames_tracked,
    people_notes,
)
from posefuse.pipeline.people.stills import STILLS, stills_note
from posefuse.pipeline.people.tracked_people import TrackedPeople
from posefuse.pipeline.people.trackers import unmodeled_note
from posefuse.pipeline.plan import Plan, useful_jobs
from posefuse.pipeline.solved_layer import LayerSolver, Postprocess, Step
from posefuse.postprocess.bones import median_bones
from posefuse.preprocess import time_offsets
from posefuse.preprocess.match_cameras import match_views
from posefuse.preprocess.timeline import align_views
from posefuse.preprocess.weights import weight_by_sigma
from posefuse.progress import Progress, Silent
from posefuse.triangulation.registry import find_method

_version = cache(version)


@checked
def reconstruct(
    rig: CameraRig,
    detections: Detections,
    options: Options | None = None,
    *,
    progress: Progress | None = None,
    checkpoint: Checkpoint = NO_CHECKPOINT,
    jobs: JobCount = 1,
) -> Reconstruction:
    """Reconstruct people in 3D from calibrated views.

    Args:
        rig: calibrated cameras. Views are matched to cameras by name; see :func:`match_views`.
        detections: 2D keypoints.
        options: options of the reconstruction; the defaults suit one person.
        progress: receives the progress.
        checkpoint: stores finished parts of a long recording (:class:`posefuse.io.checkpoints.CheckpointFolder`); the
            same call resumes from them after an interruption.
        jobs: number of processes; "auto" uses the physical cores if the recording is long enough. The result does not
            depend on it.

    Returns:
        The reconstruction, in memory, with the findings of the recording check in ``findings``.

    Raises:
        MatchError: if views and cameras do not match.
        DetectionsError: if the detections do not allow what the options ask for.
        OptionsError: if ``jobs`` is less than 1.
    """
    progress = progress or Silent()
    with Jobs(number_of_jobs(jobs, useful_jobs(detections))) as workers:
        plan = prepare(rig, detections, options or Options(), progress, checkpoint, jobs=workers)
        findings = begin_check(plan, workers)
        plan = replace(with_layer_scores(plan, workers), findings=findings())
        parts = reconstruct_chunks(plan, progress, checkpoint, workers)
        return with_joint_angles(concatenate_ranges(parts, plan.detections.n_frames), workers)


@checked
def triangulate(rig: CameraRig, detections: Detections, options: Options | None = None) -> Reconstruction:
    """Compute the ``measured`` layer only, without filling, smoothing, solving over time or a recording check.

    The arguments, the result and the errors are those of :func:`reconstruct`.
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
    find: FindStoredSubjects | None = None,
    jobs: Jobs = ONE_JOB,
) -> Plan:
    """Determine everything that needs the whole recording: views, frames, subjects, noise, method, world and solver.

    Args:
        rig: calibrated cameras.
        detections: 2D keypoints.
        options: options of the reconstruction.
        progress: receives the progress.
        checkpoint: stores the state of tracking. If tracking is interrupted, the plan covers the frames tracked so far.
        find: assigns detections to people, by default :func:`find_subjects`. It gets a checkpoint of its own in a world
            of another size.
        jobs: processes that track hands and faces and measure samples.
    """
    find = find or partial(find_subjects, jobs=jobs)
    plan = examine(rig, detections, options, progress, partial(find, checkpoint=checkpoint))
    align = plan.options.align
    if align.turns or align.scales or plan.options.postprocess.rigid_bones:
        plan = with_sample(plan)
    scale = None
    if align.scales:
        scale = scale_factor(sample_points(plan), plan.detections.skeleton, align)
        again = checkpoint.child(f"resized_{plan.detections.n_frames}")
        plan = resize(plan, scale, progress, partial(find, checkpoint=again))
    if isinstance(plan.bodies, TrackedPeople):
        # One process estimates priors of the smoother while this one estimates those of the solve.
        plan = replace(plan, bodies=plan.bodies.with_priors(jobs))
    return with_solver(with_alignment(with_up(with_findings(plan)), scale), jobs)


def examine(
    rig: CameraRig, detections: Detections, options: Options, progress: Progress, find: FindSubjects = find_subjects
) -> Plan:
    """Determine views, frames, options, subjects and noise.

    Returns:
        A plan that can be measured, without findings, alignment and solver.
    """
    if detections.n_frames == 0:
        raise DetectionsError("The recording is empty: it has no frames.")
    requested = options
    rig, detections, notes = used_inputs(rig, detections, options)
    # Options that depend on the recording.
    facts = RecordingFacts.of(detections)
    options = resolve_options(options, facts, len(rig))
    if options.people == STILLS:
        notes = (*notes, stills_note(requested, facts.interval_s))
    # Time offsets of the views, and weights of the detections.
    shifted, weight_notes = None, ()
    if not options.sync.does_nothing:
        shifted = time_offsets.shift_views(detections, rig.names, options.sync)
        detections, notes = shifted.detections, (*notes, *shifted.notes)
    n_frames = detections.n_frames
    if detections.sigma_px is not None:
        default_px = None if fixed_noise(rig, options) else float(np.median(assumed_noise(rig, 1.0).scale_px))
        options, detections, weight_notes = weight_by_sigma(detections, options, default_px)
    # Subjects.
    subjects, bodies = find(rig, detections, options, progress)
    n_tracked, partial_notes = frames_tracked(bodies or subjects), ()
    if n_tracked is not None and n_tracked < n_frames:
        detections, partial_notes = detections.between(0, n_tracked), (partial_note(n_tracked, n_frames),)
    if shifted is not None:
        detections = time_offsets.interpolate_to_frame_times(shifted.with_detections(detections), subjects)
    if isinstance(subjects, SingleSubject) and subjects.note:
        notes = (*notes, subjects.note)
    if bodies is not None:
        notes = (*notes, *unmodeled_note(bodies.skeleton))
    notes = (*notes, *people_notes(detections, subjects, options))
    # Noise. Without people, detections that are alone in their views still show what is wrong.
    found = bool(subjects.tracks(0, 0).person_ids)
    sampled = subjects if found else lone_detections(detections)
    samples = take_samples(detections, sampled) if len(rig) > 1 else None
    noise = estimate_noise(rig, samples, options, progress)
    if found and samples is not None and noise.layer is not None:
        notes = (*notes, *_shift_notes(rig, noise.layer, samples))
    provenance = Provenance(
        versions={"posefuse": _version("posefuse"), "numpy": np.__version__, "python": python_version()},
        notes=(*partial_notes, *rig.notes, *detections.notes, *notes, *weight_notes),
    )
    plan = Plan(rig, detections, requested, options, subjects, bodies, noise.noise, provenance, noise.layer)
    return _with_resolved_method(plan, options, facts)


def _shift_notes(rig: CameraRig, layer: Layer, samples: Samples) -> tuple[str, ...]:
    """Return a note if the points of a sample show shifted views."""
    sample = next(each for each in (samples.large, samples.small) if each.detections.n_frames == len(layer.points_m))
    note = shift_note(rig, layer, sample.detections, sample.tracks)
    return () if note is None else (note,)


def used_inputs(
    rig: CameraRig, detections: Detections, options: Options
) -> tuple[CameraRig, Detections, tuple[str, ...]]:
    """Return the cameras, views and frames that a reconstruction uses, on one timeline, and notes.

    Raises:
        MatchError: if views and cameras do not match.
        DetectionsError: if no frame is left.
    """
    if options.rate_hz is not None and detections.rate_hz is None:
        detections = detections.with_rate(options.rate_hz)
    detections = align_views(detections, options.reference_view)
    rig, detections, notes = match_views(rig, detections, options)
    return rig, cut_time(detections, options), notes


def with_method(plan: Plan, method: str) -> Plan:
    """Return the plan for another triangulation method, without alignment and solver.

    Options that depend on the method are resolved again from what the user requested.
    """
    requested = plan.requested
    triangulation = replace(
        plan.options.triangulation,
        method=method,
        min_views=requested.triangulation.min_views,
        percentile_filter=requested.triangulation.percentile_filter,
    )
    options = replace(plan.options, triangulation=triangulation, pairs=requested.pairs, solve=requested.solve)
    plan = replace(plan, solver=None, alignment=None, sample_m=None)
    return _with_resolved_method(plan, options, RecordingFacts.of(plan.detections))


def _with_resolved_method(plan: Plan, options: Options, facts: RecordingFacts) -> Plan:
    options, notes = resolve_method(options, facts, len(plan.rig))
    return _with_fitted_method(replace(plan, options=options, provenance=plan.provenance.with_notes(notes)))


def _with_fitted_method(plan: Plan) -> Plan:
    """Let a method that needs the whole recording first, such as ``percentile_filter``, read it.

    Its notes replace those of an earlier preparation.
    """
    kept = tuple(note for note in plan.provenance.notes if note not in plan.method_notes)
    plan = replace(plan, provenance=replace(plan.provenance, notes=kept), method_notes=())
    method = find_method(plan.options.triangulation.method)
    if method.prepare is None or len(plan.rig) == 1:
        return plan

    def pieces() -> Iterator[tuple[Detections, Tracks]]:
        for span in ranges(plan.detections.n_frames, CHUNK_FRAMES):
            yield plan.detections.frames(*span), plan.subjects.tracks(*span)

    triangulation, notes = method.prepare(plan.rig, pieces, plan.noise, plan.options.triangulation)
    options = replace(plan.options, triangulation=triangulation)
    return replace(plan, options=options, provenance=plan.provenance.with_notes(notes), method_notes=notes)


def with_sample(plan: Plan) -> Plan:
    """Measure a sample of the recording by the chosen method, which scale, alignment and bones read."""
    detections = plan.detections
    spans = sample_spans(detections.n_frames, len(detections.skeleton) * detections.n_views)
    points = (measure(plan, *span).layers["measured"].points_m for span in spans)
    return replace(plan, sample_m=tuple(np.asarray(each) for each in points))


def sample_points(plan: Plan) -> tuple[np.ndarray, ...]:
    """Return the points of the plan's sample, one array of shape (frame, person, keypoint, 3) per range of frames."""
    assert plan.sample_m is not None
    return plan.sample_m


def resize(plan: Plan, scale: float, progress: Progress, find: FindSubjects) -> Plan:
    """Return the plan in a world of another size.

    The assignment and the noise of one subject do not depend on the size of the world, so its points are scaled.
    Tracking does, since it uses the speeds and lengths of bodies, so people are tracked again.

    Args:
        plan: plan with a sample, without findings, alignment and solver.
        scale: factor that multiplies all lengths.
        progress: receives the progress.
        find: assigns detections to people.
    """
    rig = scaled_rig(plan.rig, scale)
    if plan.bodies is None and isinstance(plan.subjects, SingleSubject):
        agreement = None if plan.agreement is None else scaled_layer(plan.agreement, scale)
        return replace(
            plan, rig=rig, agreement=agreement, sample_m=tuple(scale * points for points in sample_points(plan))
        )
    subjects, bodies = find(rig, plan.detections, plan.options, progress)
    n_tracked, n_frames = frames_tracked(bodies or subjects), plan.detections.n_frames
    if n_tracked is not None and n_tracked < n_frames:
        provenance = plan.provenance.with_notes((partial_note(n_tracked, n_frames),))
        plan = replace(plan, detections=plan.detections.between(0, n_tracked), provenance=provenance)
    known = plan.provenance.notes
    notes = (note for note in people_notes(plan.detections, subjects, plan.options) if note not in known)
    plan = replace(plan, provenance=plan.provenance.with_notes(notes))
    noise = estimate_noise(rig, take_samples(plan.detections, subjects), plan.options, progress)
    plan = replace(plan, rig=rig, subjects=subjects, bodies=bodies, noise=noise.noise, agreement=noise.layer)
    requested = plan.requested.triangulation.percentile_filter
    triangulation = replace(plan.options.triangulation, percentile_filter=requested)
    return with_sample(_with_fitted_method(replace(plan, options=replace(plan.options, triangulation=triangulation))))


def with_findings(plan: Plan) -> Plan:
    """Return the plan with a note or finding, and a warning, of each problem that the noise estimate's sample shows.

    This sample is triangulated by ``consensus`` whatever the chosen method: it must reject views that contradict the
    others.
    """
    if plan.agreement is None:
        return plan
    notes, findings = sample_findings(plan.rig, plan.agreement, plan.noise, plan.detections.skeleton)
    return replace(plan, findings=findings, provenance=plan.provenance.with_notes(notes))


def with_up(plan: Plan) -> Plan:
    """Return the plan with the up direction inferred from people, where the calibration and the options state none.

    A note says so, or that the up axis is unknown.
    """
    if plan.rig.up is not None or len(plan.rig) == 1:
        return plan
    if plan.sample_m is None:
        plan = with_sample(plan)
    parts = sample_points(plan)
    if plan.options.people == STILLS:
        parts = [part[i : i + 1] for part in parts for i in range(len(part))]
    up, reason = infer_up(parts, plan.detections.skeleton, plan.rig, plan.detections.rate_hz)
    rig = plan.rig.with_up(None, up)
    return replace(plan, rig=rig, provenance=plan.provenance.with_notes((describe_up(up, reason),)))


def with_alignment(plan: Plan, scale: float | None) -> Plan:
    """Return the plan with the alignment that the options ask for, and notes on how it was determined.

    Args:
        plan: plan in a world of the final size.
        scale: factor by which lengths were multiplied, or None.

    Raises:
        DetectionsError: if people do not show what the alignment needs.
        OptionsError: if the up axis is unknown.
    """
    align = plan.options.align
    if not (align.turns or align.scales):
        return plan
    if len(plan.rig) == 1:
        raise OptionsError(
            "align: with one camera, coordinates are in its image plane and cannot be aligned. Remove the align "
            "options."
        )
    alignment = identity_alignment(plan.rig)
    if align.turns:
        alignment = find_alignment(sample_points(plan), plan.detections.skeleton, plan.rig, align)
    if scale is not None:
        alignment = combine_with_scale(alignment, scale, align)
    return replace(plan, alignment=alignment, provenance=plan.provenance.with_notes(alignment.steps))


def with_solver(plan: Plan, jobs: Jobs = ONE_JOB) -> Plan:
    """Return the plan with the steps that compute the solved layer, if the options ask for any.

    Args:
        plan: plan in its final world.
        jobs: processes that measure the sample to which priors are fitted.

    Raises:
        DetectionsError: if a step needs times and frames have none.
        OptionsError: if a filter is not possible at this frame rate.
    """
    steps: list[Step] = []
    if plan.options.solve == "trajectory":
        # In ranges: no more than one range of a long recording in a file is in memory at a time.
        pieces = ranges(plan.detections.n_frames, CHUNK_FRAMES)
        states = np.concatenate([np.asarray(plan.subjects.tracks(*piece).state) for piece in pieces])
        if states.shape[1]:
            sample = MeasuredRanges(plan, trajectory_fit.training_spans(states), jobs)
            step = trajectory_fit.fit_trajectory(plan.rig, plan.detections, plan.noise, sample, plan.options.trajectory)
            if plan.options.contact == "on":
                step = trajectory_fit.with_contact(step, sample)
            steps.append(step)
    postprocess = plan.options.postprocess
    if not postprocess.does_nothing:
        bones = median_bones(sample_points(plan), plan.detections.skeleton) if postprocess.rigid_bones else None
        steps.append(Postprocess.of(plan.rig, plan.detections, plan.options, bones))
    if not steps:
        return plan
    return replace(plan, solver=LayerSolver(tuple(steps), solved_layer.clock_of(plan.detections).period_s))
