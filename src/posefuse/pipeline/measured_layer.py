"""Carry out a plan range of frames by range: measure, solve over time, align and checkpoint."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import takewhile

import numpy as np

from posefuse.alignment.apply import align_parts
from posefuse.arrays import ranges
from posefuse.checkpoint import NO_CHECKPOINT, Checkpoint
from posefuse.left_right import relabel
from posefuse.model.detections import Detections
from posefuse.model.label_swaps import Swaps
from posefuse.model.layer_statuses import with_true_statuses
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.result_ranges import FrameRange
from posefuse.model.status import ViewStatus, is_used
from posefuse.model.tracks import Tracks
from posefuse.pipeline import solved_layer
from posefuse.pipeline.people import WholeSmoother
from posefuse.pipeline.people.keypoint_deviations import with_deviations
from posefuse.pipeline.people.stills import STILLS
from posefuse.pipeline.plan import Plan, empty_result
from posefuse.pipeline.solved_layer import LayerSolver
from posefuse.progress import Progress, report_ranges
from posefuse.triangulation import single_view
from posefuse.triangulation.registry import find_method

_CONTEXT_S = 5.0
_MAX_CONTEXT_FRAMES = 1024
PARTIAL = "Partial: "
"""Prefix of the note on a result that does not cover the whole recording."""

_MEASURED, _SOLVED, _SMOOTHER = "measured_{:06d}", "solved_{:06d}", "smoother_{}"


def reconstruct_chunks(
    plan: Plan, progress: Progress, checkpoint: Checkpoint = NO_CHECKPOINT
) -> Iterator[Reconstruction]:
    """Return the reconstruction in consecutive ranges of frames, for recordings that do not fit in memory.

    Args:
        plan: plan of the reconstruction.
        progress: receives the progress.
        checkpoint: stores finished ranges and returns those of an earlier, interrupted run.
    """
    n_frames = plan.detections.n_frames
    checkpoint = checkpoint.child(_stage_name(plan))
    parts = _measured(plan, checkpoint) if plan.solver is None else _solved(plan, plan.solver, checkpoint)
    if plan.alignment is not None:
        parts = align_parts(parts, plan.alignment)
    yield from report_ranges(parts, n_frames, "triangulating", progress)


def finished_chunks(plan: Plan, checkpoint: Checkpoint) -> Iterator[Reconstruction]:
    """Return the leading ranges that an interrupted run finished.

    Their provenance notes that the result is partial; events after the last finished frame are left out.
    """
    checkpoint = checkpoint.child(_stage_name(plan))
    size, name = (plan.options.chunk_frames, _MEASURED) if plan.solver is None else (plan.solver.size, _SOLVED)
    spans = ranges(plan.detections.n_frames, size)
    finished = list(takewhile(lambda each: checkpoint.contains(name.format(each[0])), enumerate(spans)))
    if not finished:
        return
    last = finished[-1][1][1]
    until = int(plan.detections.frame_numbers[last - 1])
    note = partial_note(last, plan.detections.n_frames)
    provenance = replace(plan.provenance, notes=(note, *plan.provenance.notes))
    events = tuple(event for event in plan.events if event.number <= until)
    head = replace(empty_result(plan), provenance=provenance, events=events)
    parts = (checkpoint.load(name.format(i)).to_reconstruction(head) for i, _ in finished)
    yield from parts if plan.alignment is None else align_parts(parts, plan.alignment)


def partial_note(done: int, n_frames: int) -> str:
    """Return the note of a result that does not cover the whole recording."""
    return (
        f"{PARTIAL}made of the first {done} of {n_frames} frames, because the run was interrupted. Run the same "
        "command again to resume it."
    )


def _stage_name(plan: Plan) -> str:
    """Return the checkpoint's name; the ranges of a part of a recording differ from those of all of it."""
    return f"frames_{plan.detections.n_frames}"


def _measured(plan: Plan, checkpoint: Checkpoint, first: int = 0) -> Iterator[Reconstruction]:
    """Return the measured and model layers from chunk ``first`` on, loading those that are stored."""
    smoother = None if plan.bodies is None else plan.bodies.smoother()
    head, smoothed = empty_result(plan) if checkpoint.enabled else None, 0
    for i, (start, stop) in enumerate(ranges(plan.detections.n_frames, plan.options.chunk_frames)):
        name = _MEASURED.format(i)
        if i < first and checkpoint.contains(name):
            continue
        stored = checkpoint.load(name)
        if stored is None:
            if smoother is not None and smoothed != start:
                smoother = _smoother_at(plan, checkpoint, start)
            part = measure(plan, start, stop, smoother)
            smoothed = stop
            if smoother is not None and checkpoint.enabled:
                # Two names alternate: one of them is always intact and ends where the first missing chunk begins.
                smoother.resume_from(checkpoint.save(_SMOOTHER.format(i % 2), smoother.memory))
            stored = checkpoint.save(name, FrameRange.of(part)) if checkpoint.enabled else None
            if stored is None:
                yield part
                continue
        assert head is not None
        yield stored.to_reconstruction(head)


def _smoother_at(plan: Plan, checkpoint: Checkpoint, start: int) -> WholeSmoother:
    """Return the smoother of tracked people after the frames up to ``start``."""
    assert plan.bodies is not None
    smoother = plan.bodies.smoother()
    memories = (checkpoint.load(_SMOOTHER.format(i)) for i in range(2))
    memory = next((each for each in memories if each is not None and each[0].done == start), None)
    if memory is not None:
        smoother.resume_from(memory)
        return smoother
    # The stored state is damaged: smooth the earlier frames again.
    for stop in (stop for _, stop in ranges(start, plan.options.chunk_frames)):
        smoother.take(stop)
    return smoother


def _solved(plan: Plan, solver: LayerSolver, checkpoint: Checkpoint) -> Iterator[Reconstruction]:
    """Return the measured, solved and model layers, loading the ranges that are stored."""
    n_frames, chunk = plan.detections.n_frames, plan.options.chunk_frames
    spans = list(ranges(n_frames, solver.size))
    done = 0
    if checkpoint.enabled:
        head = empty_result(plan)
        while done < len(spans) and (stored := checkpoint.load(_SOLVED.format(done))) is not None:
            done += 1
            yield stored.to_reconstruction(head)
    if done == len(spans):
        return
    first = max(spans[done][0] - solver.margin, 0) // chunk
    parts = _measured(plan, checkpoint, first)
    for i, part in enumerate(solver.solve(parts, n_frames, done=done, begin=first * chunk), done):
        if checkpoint.enabled:
            part = checkpoint.save(_SOLVED.format(i), FrameRange.of(part)).to_reconstruction(part)
        yield part


def measure(plan: Plan, start: int, stop: int, smoother: WholeSmoother | None = None) -> Reconstruction:
    """Measure a range of frames: triangulated points, and bodies where people were tracked.

    Args:
        plan: plan of the reconstruction.
        start: index of the first frame.
        stop: index after the last frame.
        smoother: smoother of the tracked people, advanced to ``start``, to add the model layer; or None.
    """
    # Sides are decided over time, which takes frames before and after the range.
    context = context_frames(plan)
    first, last = max(start - context, 0), min(stop + context, plan.detections.n_frames)
    around = plan.detections.frames(first, last)
    tracks_around = plan.subjects.tracks(first, last)
    layer, swaps = measure_layer(plan, around, tracks_around)
    detections, tracks = around.frames(start - first, stop - first), tracks_around.frames(start - first, stop - first)
    layers = {"measured": layer.frames(start - first, stop - first)}
    poses = None
    if plan.bodies is not None and smoother is not None:
        layers["model"], poses = plan.bodies.bodies(plan.rig, detections, start, smoother.take(stop))
    part = FrameRange(
        detections.frame_numbers,
        solved_layer.mean_times(detections),
        {name: with_true_statuses(layer) for name, layer in layers.items()},
        tracks,
        None if swaps is None else swaps.frames(start - first, stop - first),
        poses,
    ).to_reconstruction(empty_result(plan))
    return with_deviations(part, detections, plan.deviation_sd_m)


def context_frames(plan: Plan) -> int:
    """Return the number of frames before and after a range from which its sides are decided."""
    if plan.options.pairs == "labels" or plan.options.people == STILLS:
        return 0
    return min(round(_CONTEXT_S * (plan.detections.rate_hz or 30.0)), _MAX_CONTEXT_FRAMES)


def measure_layer(plan: Plan, detections: Detections, tracks: Tracks) -> tuple[Layer, Swaps | None]:
    """Triangulate a range of frames and decide left/right swaps; one camera is only flattened.

    Returns:
        The layer, and the swaps, or None where labels are used as they are.
    """
    rig, noise, options = plan.rig, plan.noise, plan.options
    if len(rig) == 1:
        return single_view.solve(detections, tracks, noise, options.triangulation), None
    swaps = None
    if options.pairs == "labels":
        method = find_method(options.triangulation.method)
        layer = method.solve(rig, detections, tracks, noise, options.triangulation)
    else:
        layer, swaps = relabel.solve(rig, detections, tracks, noise, options)
    layer = replace(layer, covariance_m2=np.asarray(layer.covariance_m2) * noise.spread**2)
    return _with_rejected_cameras(layer, noise), swaps


def _with_rejected_cameras(layer: Layer, noise: NoiseModel) -> Layer:
    """Return the layer with cameras that determine nothing as rejected views, where two others determine the point."""
    if noise.is_used.all():
        return layer
    status = np.asarray(layer.view_status)
    determined = (is_used(status) & noise.is_used).sum(axis=-1, keepdims=True) > 1
    rejected = is_used(status) & ~noise.is_used & determined
    return replace(layer, view_status=np.where(rejected, ViewStatus.OUTLIER, status).astype(status.dtype))
