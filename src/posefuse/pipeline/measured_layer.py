"""Carry out a plan range of frames by range: measure, solve over time, align and checkpoint."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np

from posefuse.alignment.apply import align_parts
from posefuse.arrays import ranges
from posefuse.checkpoint import NO_CHECKPOINT, Checkpoint
from posefuse.free_memory import release_free_memory
from posefuse.left_right import relabel
from posefuse.model.detections import Detections
from posefuse.model.label_swaps import Swaps
from posefuse.model.layer_statuses import with_true_statuses
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.result_ranges import FrameRange
from posefuse.model.status import ViewStatus, is_used
from posefuse.model.subjects import FixedSubjects
from posefuse.model.tracks import Tracks
from posefuse.parallel import ONE_JOB, Jobs
from posefuse.pipeline import solved_layer
from posefuse.pipeline.people.keypoint_deviations import with_deviations
from posefuse.pipeline.people.stills import STILLS
from posefuse.pipeline.people.tracked_people import SmoothedWhole, WholeSmoother
from posefuse.pipeline.plan import Plan, empty_result
from posefuse.pipeline.solved_layer import LayerSolver
from posefuse.progress import Progress, report_ranges
from posefuse.triangulation import single_view
from posefuse.triangulation.registry import find_method

_CONTEXT_S = 5.0
_MAX_CONTEXT_FRAMES = 1024
_POINT_BYTES, _MAX_KEPT_BYTES = 200, 2e8
"""Approximate size of a measured point, and the bound of what :class:`MeasuredRanges` keeps."""

PARTIAL = "Partial: "
"""Prefix of the note on a result that does not cover the whole recording."""

_MEASURED, _SOLVED, _SMOOTHER = "measured_{:06d}", "solved_{:06d}", "smoother_{}"
_SMOOTHERS = 4
"""Number of states of the smoother that are stored."""


def reconstruct_chunks(
    plan: Plan, progress: Progress, checkpoint: Checkpoint = NO_CHECKPOINT, jobs: Jobs = ONE_JOB
) -> Iterator[Reconstruction]:
    """Return the reconstruction in consecutive ranges of frames, for recordings that do not fit in memory.

    Args:
        plan: plan of the reconstruction.
        progress: receives the progress.
        checkpoint: stores finished ranges and returns those of an earlier, interrupted run.
        jobs: processes that measure, smooth and solve.
    """
    n_frames = plan.detections.n_frames
    checkpoint = checkpoint.child(_stage_name(plan))
    parts = _measured(plan, checkpoint, jobs) if plan.solver is None else _solved(plan, plan.solver, checkpoint, jobs)
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


def _measured(plan: Plan, checkpoint: Checkpoint, jobs: Jobs, first: int = 0) -> Iterator[Reconstruction]:
    """Return the measured and model layers from chunk ``first`` on, loading those that are stored."""
    head = empty_result(plan)
    spans = list(enumerate(ranges(plan.detections.n_frames, plan.options.chunk_frames)))
    names = {i: _MEASURED.format(i) for i, _ in spans}
    needed = spans[first:]
    missing = {i: span for i, span in needed if checkpoint.load(names[i]) is None}
    # Points and people of the next chunks are computed while this one is used.
    people = jobs.ahead(_smoothed(plan, checkpoint, jobs, missing))
    pieces = ((span, piece_of(plan, *span)) for span in missing.values())
    # No piece waits for a process, because each takes much memory.
    points = jobs.in_order_with(measure_points, (((span, piece), piece) for span, piece in pieces), jobs.number - 1)
    for i, _ in needed:
        if i not in missing:
            yield checkpoint.load(names[i]).to_reconstruction(head)
            continue
        (span, piece), measured = next(points)
        part = _with_bodies(plan, span[0], piece, measured, next(people))
        if checkpoint.enabled:
            part = checkpoint.save(names[i], FrameRange.of(part)).to_reconstruction(head)
        del piece, measured
        release_free_memory()
        yield part
        del part


def _smoothed(
    plan: Plan, checkpoint: Checkpoint, jobs: Jobs, missing: Mapping[int, tuple[int, int]]
) -> Iterator[SmoothedWhole | None]:
    """Yield the people of the missing chunks, smoothed from one chunk to the next; None without tracked people."""
    if plan.bodies is None:
        yield from (None for _ in missing)
        return
    smoother, done = plan.bodies.smoother(jobs), 0
    for i, (start, stop) in missing.items():
        if done != start:
            smoother = _smoother_at(plan, checkpoint, start, jobs)
        people, done = smoother.take(stop), stop
        if checkpoint.enabled:
            # People are at most one chunk ahead of what is stored. So one of the states always ends where the first
            # missing chunk begins, whenever the run is interrupted.
            smoother.resume_from(checkpoint.save(_SMOOTHER.format(i % _SMOOTHERS), smoother.memory))
        yield people
        # The caller may have written this chunk before the next one is computed.
        del people


def _smoother_at(plan: Plan, checkpoint: Checkpoint, start: int, jobs: Jobs) -> WholeSmoother:
    """Return the smoother of tracked people after the frames up to ``start``."""
    assert plan.bodies is not None
    smoother = plan.bodies.smoother(jobs)
    memories = (checkpoint.load(_SMOOTHER.format(i)) for i in range(_SMOOTHERS))
    memory = next((each for each in memories if each is not None and each[0].done == start), None)
    if memory is not None:
        smoother.resume_from(memory)
        return smoother
    # The stored state is damaged: smooth the earlier frames again.
    for _, stop in ranges(start, plan.options.chunk_frames):
        smoother.take(stop)
    return smoother


def _solved(plan: Plan, solver: LayerSolver, checkpoint: Checkpoint, jobs: Jobs) -> Iterator[Reconstruction]:
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

    def first_needed(done: int) -> int:
        """Return the first measured chunk that later ranges read."""
        return max(spans[done][0] - solver.margin, 0) // chunk if done < len(spans) else -(-n_frames // chunk)

    first = discarded = first_needed(done)
    parts = _measured(plan, checkpoint, jobs, first)
    # Not by enumerate, which would keep each range until the next one is complete.
    for part in solver.solve(parts, n_frames, done=done, begin=first * chunk, jobs=jobs):
        if checkpoint.enabled:
            part = checkpoint.save(_SOLVED.format(done), FrameRange.of(part)).to_reconstruction(part)
        done += 1
        # Solved ranges contain the measured layer, which takes much space on the disk.
        for i in range(discarded, first_needed(done)):
            checkpoint.discard(_MEASURED.format(i))
        discarded = first_needed(done)
        release_free_memory()
        yield part
        del part


@dataclass(frozen=True, eq=False)
class Piece:
    """A range of frames to measure, with what its measurement depends on, in memory.

    Attributes:
        plan: plan of the range and of the frames around it, without what only other stages need.
        start: index of the first frame of the range in it.
        stop: index after its last frame.
    """

    plan: Plan
    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class MeasuredPoints:
    """Triangulated points of a range of frames, and left/right swaps, or None where labels are used as they are."""

    layer: Layer
    swaps: Swaps | None


def piece_of(plan: Plan, start: int, stop: int) -> Piece:
    """Return the piece for a range of frames."""
    # Sides are decided over time, which takes frames before and after the range.
    context = context_frames(plan)
    first, last = max(start - context, 0), min(stop + context, plan.detections.n_frames)
    subjects = FixedSubjects(plan.subjects.tracks(first, last))
    part = replace(
        plan, detections=plan.detections.frames(first, last), subjects=subjects, bodies=None, solver=None,
        alignment=None, agreement=None, sample_m=None, findings=(), layer_scores=(),
    )  # fmt: skip
    return Piece(part, start - first, stop - first)


def measure_points(piece: Piece) -> MeasuredPoints:
    """Triangulate the frames of a piece and decide left/right swaps."""
    plan = piece.plan
    layer, swaps = measure_layer(plan, plan.detections, plan.subjects.tracks(0, plan.detections.n_frames))
    layer = with_true_statuses(layer.frames(piece.start, piece.stop))
    return MeasuredPoints(layer, None if swaps is None else swaps.frames(piece.start, piece.stop))


def measure_range(piece: Piece) -> FrameRange:
    """Measure the frames of a piece, without bodies."""
    return FrameRange.of(_with_bodies(piece.plan, piece.start, piece, measure_points(piece), None))


def measure(plan: Plan, start: int, stop: int, people: SmoothedWhole | None = None) -> Reconstruction:
    """Measure a range of frames: triangulated points, and bodies where people were tracked.

    Args:
        plan: plan of the reconstruction.
        start: index of the first frame.
        stop: index after the last frame.
        people: smoothed people of these frames, to add the model layer; or None.
    """
    piece = piece_of(plan, start, stop)
    return _with_bodies(plan, start, piece, measure_points(piece), people)


class MeasuredRanges:
    """Ranges of a recording, measured without bodies; they are kept in memory up to a bound, and measured again beyond.

    Args:
        plan: plan of the reconstruction.
        spans: first frame and end of each range.
        jobs: processes that measure.
    """

    def __init__(self, plan: Plan, spans: Sequence[tuple[int, int]], jobs: Jobs = ONE_JOB) -> None:
        self._plan, self.spans, self._jobs = plan, tuple(spans), jobs
        self._kept: list[Reconstruction] = []
        self._size = 0

    def __len__(self) -> int:
        return len(self.spans)

    def __iter__(self) -> Iterator[tuple[tuple[int, int], Reconstruction]]:
        """Yield first frame and end of each range, and its frames with their measured layer."""
        n_kept = len(self._kept)
        yield from zip(self.spans[:n_kept], self._kept, strict=True)
        pieces = ((span, piece_of(self._plan, *span)) for span in self.spans[n_kept:])
        for (span, piece), points in self._jobs.in_order_with(measure_points, (((s, p), p) for s, p in pieces)):
            part = _with_bodies(self._plan, span[0], piece, points, None)
            self._size += _POINT_BYTES * part.layers["measured"].status.size
            if self._size < _MAX_KEPT_BYTES:
                self._kept.append(part)
            yield span, part


def _with_bodies(
    plan: Plan, start: int, piece: Piece, points: MeasuredPoints, people: SmoothedWhole | None
) -> Reconstruction:
    """Return a measured range of frames from ``start`` on, with the bodies of smoothed people."""
    detections = piece.plan.detections.frames(piece.start, piece.stop)
    layers, poses = {"measured": points.layer}, None
    if plan.bodies is not None and people is not None:
        model, poses = plan.bodies.bodies(plan.rig, detections, start, people)
        layers["model"] = with_true_statuses(model)
    part = FrameRange(
        detections.frame_numbers,
        solved_layer.mean_times(detections),
        layers,
        piece.plan.subjects.tracks(piece.start, piece.stop),
        points.swaps,
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
