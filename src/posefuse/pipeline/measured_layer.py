"""A settled plan carried out, range of frames by range: measured, smoothed, solved, laid, and kept."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np

from posefuse.alignment.apply import align_parts
from posefuse.arrays import ranges
from posefuse.checkpoint import NO_CHECKPOINT, Checkpoint
from posefuse.left_right import relabel
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.label_swaps import Swaps
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Layer, Provenance, Reconstruction
from posefuse.model.result_ranges import Piece
from posefuse.model.subjects import Subjects
from posefuse.model.track_events import Event
from posefuse.model.tracks import Tracks
from posefuse.pipeline import solved_layer
from posefuse.pipeline.people import TrackedPeople, WholeSmoother
from posefuse.pipeline.solved_layer import Solver
from posefuse.progress import Progress, watched
from posefuse.triangulation import single_view
from posefuse.triangulation.registry import find_method

_CONTEXT_S = 5.0
_MOST_CONTEXT_FRAMES = 1024
PARTIAL = "Partial: "
"""How a note on a result that is not of the whole recording begins."""


@dataclass(frozen=True)
class Plan:
    """What is settled before the first frame: matched views, options with nothing left open, noise.

    Attributes:
        rig: one camera per view, in the views' order.
        detections: the frames and views to reconstruct.
        options: as given, with ``pairs`` and ``min_views`` settled.
        subjects: who is followed.
        bodies: fitted to them, or None.
        noise: of the detections.
        provenance: how the result is made.
        solver: makes the solved layer, or None where there is to be none.
        alignment: of the world of the result, or None where it is the calibration's.
    """

    rig: CameraRig
    detections: Detections
    options: Options
    subjects: Subjects
    bodies: TrackedPeople | None
    noise: NoiseModel
    provenance: Provenance
    solver: Solver | None = None
    alignment: Alignment | None = None


def reconstruct_chunks(
    plan: Plan, progress: Progress, checkpoint: Checkpoint = NO_CHECKPOINT
) -> Iterator[Reconstruction]:
    """The reconstruction in consecutive ranges of frames, for recordings that do not fit in memory.

    Args:
        plan: what is settled.
        progress: told how far the work is.
        checkpoint: keeps ranges that are done, and gives those that were done before.
    """
    n_frames = plan.detections.n_frames
    checkpoint = checkpoint.child(_stage_of(plan))
    parts = _measured(plan, checkpoint) if plan.solver is None else _solved(plan, plan.solver, checkpoint)
    if plan.alignment is not None:
        parts = align_parts(parts, plan.alignment)
    yield from watched(parts, n_frames, "triangulating", progress)


def finished_chunks(plan: Plan, checkpoint: Checkpoint) -> Iterator[Reconstruction]:
    """The ranges from the first on that are done and kept, of a plan that was not carried out to its end.

    They say that the rest is missing, and of nothing that happened in it.
    """
    checkpoint = checkpoint.child(_stage_of(plan))
    size, name = (plan.options.chunk_frames, _MEASURED) if plan.solver is None else (plan.solver.size, _SOLVED)
    spans = ranges(plan.detections.n_frames, size)
    kept = list(takewhile(lambda each: checkpoint.contains(name.format(each[0])), enumerate(spans)))
    if not kept:
        return
    last = kept[-1][1][1]
    until = int(plan.detections.frame_numbers[last - 1])
    note = partial_note(last, plan.detections.n_frames)
    provenance = replace(plan.provenance, notes=(note, *plan.provenance.notes))
    events = tuple(event for event in _events(plan) if event.number <= until)
    head = replace(head_of(plan), provenance=provenance, events=events)
    parts = (checkpoint.load(name.format(i)).of_result(head) for i, _ in kept)
    yield from parts if plan.alignment is None else align_parts(parts, plan.alignment)


def partial_note(done: int, n_frames: int) -> str:
    """What a result says that is not of the whole recording."""
    return (
        f"{PARTIAL}made of the first {done} of {n_frames} frames, since it was interrupted. The same command goes on "
        "from there."
    )


_MEASURED, _SOLVED, _SMOOTHER = "measured_{:06d}", "solved_{:06d}", "smoother_{}"


def _stage_of(plan: Plan) -> str:
    """What is made of part of a recording is not what is made of all of it."""
    return f"frames_{plan.detections.n_frames}"


def _measured(plan: Plan, checkpoint: Checkpoint, first: int = 0) -> Iterator[Reconstruction]:
    """The measured and model layers from chunk ``first`` on; those that are kept are not made again."""
    smoother = None if plan.bodies is None else plan.bodies.smoother()
    head, given = head_of(plan) if checkpoint.enabled else None, 0
    for i, (start, stop) in enumerate(ranges(plan.detections.n_frames, plan.options.chunk_frames)):
        name = _MEASURED.format(i)
        if i < first and checkpoint.contains(name):
            continue
        piece = checkpoint.load(name)
        if piece is None:
            if smoother is not None and given != start:
                smoother = _smoother_at(plan, checkpoint, start)
            part = measure(plan, start, stop, smoother)
            given = stop
            if smoother is not None and checkpoint.enabled:
                # Of two, one is always whole, and of where the chunk that is not kept yet begins.
                smoother.resume_from(checkpoint.save(_SMOOTHER.format(i % 2), smoother.memory))
            piece = checkpoint.save(name, Piece.of(part)) if checkpoint.enabled else None
            if piece is None:
                yield part
                continue
        assert head is not None
        yield piece.of_result(head)


def _smoother_at(plan: Plan, checkpoint: Checkpoint, start: int) -> WholeSmoother:
    """The smoother of the followed people that has given the frames up to ``start``."""
    assert plan.bodies is not None
    smoother = plan.bodies.smoother()
    memories = (checkpoint.load(_SMOOTHER.format(i)) for i in range(2))
    memory = next((each for each in memories if each is not None and each[0].done == start), None)
    if memory is not None:
        smoother.resume_from(memory)
        return smoother
    # The part that says so is damaged: what was given before is gone through again.
    for stop in (stop for _, stop in ranges(start, plan.options.chunk_frames)):
        smoother.take(stop)
    return smoother


def _solved(plan: Plan, solver: Solver, checkpoint: Checkpoint) -> Iterator[Reconstruction]:
    """The measured, solved and model layers; those that are kept are not made again."""
    n_frames, chunk = plan.detections.n_frames, plan.options.chunk_frames
    spans = list(ranges(n_frames, solver.size))
    done = 0
    if checkpoint.enabled:
        head = head_of(plan)
        while done < len(spans) and (piece := checkpoint.load(_SOLVED.format(done))) is not None:
            done += 1
            yield piece.of_result(head)
    if done == len(spans):
        return
    first = max(spans[done][0] - solver.margin, 0) // chunk
    parts = _measured(plan, checkpoint, first)
    for i, part in enumerate(solver.solve(parts, n_frames, done=done, begin=first * chunk), done):
        yield checkpoint.save(_SOLVED.format(i), Piece.of(part)).of_result(part) if checkpoint.enabled else part


def head_of(plan: Plan) -> Reconstruction:
    """What all ranges of a result share, with no frames."""
    people = plan.subjects.tracks(0, 0).person_ids
    skeleton = plan.detections.skeleton if plan.bodies is None else plan.bodies.skeleton
    points, views = (0, len(people), len(skeleton)), len(plan.rig)
    codes, seen = np.empty(points, dtype=np.int8), (*points, views)
    nothing = Layer(
        np.empty((*points, 3)), np.empty((*points, 6)), codes, codes, np.empty(points),
        np.empty(seen, dtype=np.int8), np.empty(seen, dtype=np.float32),
    )  # fmt: skip
    return Reconstruction(
        rig=plan.rig,
        skeleton=skeleton,
        person_ids=people,
        frame_numbers=np.empty(0),
        time_s=np.empty(0),
        layers={"measured": nothing},
        noise=plan.noise,
        events=_events(plan),
        rate_hz=plan.detections.rate_hz,
        unit="px" if len(plan.rig) == 1 else "m",
        options=plan.options,
        provenance=plan.provenance,
    )


def measure(plan: Plan, start: int, stop: int, smoother: WholeSmoother | None = None) -> Reconstruction:
    """What is known of the frames ``start`` to ``stop``: points as measured, and bodies where people were followed.

    Args:
        plan: what is settled.
        start: the first frame, counted from 0.
        stop: the frame after the last.
        smoother: of the followed people, if it is to give bodies; it has given those up to ``start``.
    """
    # Sides are decided over time: some of what comes before and after is looked at too.
    around = context_frames(plan)
    first, last = max(start - around, 0), min(stop + around, plan.detections.n_frames)
    seen = plan.detections.frames(first, last)
    followed = plan.subjects.tracks(first, last)
    layer, swaps = measure_layer(plan, seen, followed)
    detections, tracks = seen.frames(start - first, stop - first), followed.frames(start - first, stop - first)
    layers = {"measured": layer.frames(start - first, stop - first)}
    poses = None
    if plan.bodies is not None and smoother is not None:
        layers["model"], poses = plan.bodies.bodies(plan.rig, detections, start, smoother.take(stop))
    return Piece(
        detections.frame_numbers,
        solved_layer.mean_times(detections),
        layers,
        tracks,
        None if swaps is None else swaps.frames(start - first, stop - first),
        poses,
    ).of_result(head_of(plan))


def _events(plan: Plan) -> tuple[Event, ...]:
    known = plan.bodies or plan.subjects
    return known.events if isinstance(known, TrackedPeople) else ()


def context_frames(plan: Plan) -> int:
    """How many frames before and after a range its sides are decided with."""
    if plan.options.pairs == "labels":
        return 0
    return min(round(_CONTEXT_S * (plan.detections.rate_hz or 30.0)), _MOST_CONTEXT_FRAMES)


def measure_layer(plan: Plan, detections: Detections, tracks: Tracks) -> tuple[Layer, Swaps | None]:
    """The points of a range of frames, and which views took left for right; one camera is only flattened."""
    rig, noise, options = plan.rig, plan.noise, plan.options
    if len(rig) == 1:
        return single_view.solve(detections, tracks, noise, options.triangulation), None
    swaps = None
    if options.pairs == "labels":
        method = find_method(options.triangulation.method)
        layer = method.solve(rig, detections, tracks, noise, options.triangulation)
    else:
        layer, swaps = relabel.solve(rig, detections, tracks, noise, options)
    return replace(layer, covariance_m2=np.asarray(layer.covariance_m2) * noise.spread**2), swaps
