"""Reconstruct a long recording in pieces that other processes or machines run.

For many people, the caller first tracks through the whole recording once and stores the tracker before each window.
Three rounds of independent pieces follow: people are tracked and smoothed in windows from these trackers, ranges of
frames are measured, and blocks of frames are solved over time. Between the rounds the caller stitches the people of all
windows and determines everything that depends on the whole recording. Measured points equal those of an undivided run.

A piece is a file in a folder that all workers share, with its result beside it as a part of a
:class:`posefuse.io.checkpoints.CheckpointFolder`. An interrupted run resumes from the finished pieces.
"""

import pickle
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from posefuse.alignment.apply import align_parts
from posefuse.arrays import ranges
from posefuse.association.one_subject import SingleSubject
from posefuse.checkpoint import Checkpoint
from posefuse.io.checkpoints import CheckpointFolder
from posefuse.kinematics.angle_sds import with_root_angle_sds
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import CHUNK_FRAMES, Detections
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.result_ranges import FrameRange
from posefuse.model.subjects import Subjects
from posefuse.pipeline.defaults import BLOCK_FRAMES
from posefuse.pipeline.measured_layer import Piece, measure_range, piece_of
from posefuse.pipeline.people.find_subjects import find_subjects
from posefuse.pipeline.people.keypoint_deviations import with_deviations
from posefuse.pipeline.people.stitching import StitchedPeople, stitch
from posefuse.pipeline.people.track_recording import save_trackers
from posefuse.pipeline.people.tracked_people import TrackedPeople
from posefuse.pipeline.people.windows import (
    TrackedWindow,
    TrackingWindow,
    WindowBodies,
    shared_settings,
    track_window,
    tracking_windows,
)
from posefuse.pipeline.plan import Plan, empty_result
from posefuse.pipeline.reconstruct import prepare
from posefuse.pipeline.solved_layer import LayerSolver, clock_of, frame_windows
from posefuse.progress import Progress, report_ranges


class RunPieces(Protocol):
    """Runs pieces side by side, in other processes or on other machines."""

    def __call__(self, work: Callable[[Path], None], pieces: Sequence[Path], /) -> None:
        """Call ``work`` for each piece, and return when all are finished."""
        ...


@dataclass(frozen=True)
class Workers:
    """Workers that run the pieces of a recording.

    Attributes:
        run: runs pieces.
        window_s: approximate length of a tracking window, in seconds.
    """

    run: RunPieces
    window_s: float


@dataclass(frozen=True)
class PieceRunner:
    """Runs rounds of pieces that are stored in a folder.

    Attributes:
        folder: stores pieces and their results; workers see it under the same path.
        workers: run the pieces.
    """

    folder: CheckpointFolder
    workers: Workers

    def run(self, work: Callable[[Path], None], name: str, pieces: Iterable[Callable[[], Any]]) -> list[str]:
        """Run the pieces of one round, except those that are finished, and return the names of their results."""
        names, todo = [], []
        self.folder.begin()
        for i, piece in enumerate(pieces):
            names.append(f"{name}_{i:05d}")
            if self.folder.load(names[-1]) is None:
                todo.append(self.folder.folder / f"{names[-1]}.todo")
                todo[-1].write_bytes(pickle.dumps((self.folder.key, piece()), protocol=pickle.HIGHEST_PROTOCOL))
        self.workers.run(work, todo)
        for path in todo:
            path.unlink()
        return names


def is_long(detections: Detections, options: Options, window_s: float) -> bool:
    """Return whether a recording has times, and frames for two windows."""
    rate_hz = detections.rate_hz or options.rate_hz
    return rate_hz is not None and detections.n_frames >= 2.0 * window_s * rate_hz


def prepare_distributed(
    rig: CameraRig, detections: Detections, options: Options, runner: PieceRunner, progress: Progress
) -> Plan:
    """Prepare a plan as :func:`posefuse.pipeline.reconstruct.prepare` does, with people tracked window by window.

    Raises:
        MatchError: if views and cameras do not match.
        DetectionsError: if the detections do not allow what the options ask for.
    """

    def find(
        rig: CameraRig, detections: Detections, options: Options, progress: Progress, checkpoint: Checkpoint
    ) -> tuple[Subjects, TrackedPeople | None]:
        if options.people != "many":
            return find_subjects(rig, detections, options, progress)
        assert isinstance(checkpoint, CheckpointFolder)
        return _track_windows(rig, detections, options, replace(runner, folder=checkpoint), progress), None

    plan = prepare(rig, detections, options, progress, runner.folder, find)
    if not isinstance(plan.subjects, StitchedPeople):
        return plan
    number, overlap_s = len(plan.subjects.starts) - 1, options.tracker.terminate_after_s
    note = (
        f"People were tracked in {number} windows of about {runner.workers.window_s:g} s. Each window starts from the "
        f"state of a tracker that processed all earlier frames, and continues more than {overlap_s:g} s beyond its "
        "end. Tracks of neighboring windows were joined by their shared detections."
    )
    return replace(plan, provenance=plan.provenance.with_notes((note,)))


def reconstruct_distributed(plan: Plan, runner: PieceRunner, progress: Progress) -> Iterator[Reconstruction]:
    """Carry out a plan from :func:`prepare_distributed`, in consecutive ranges of frames.

    The body of a single subject is smoothed by the caller, since its smoother runs through the recording once.
    """
    n_frames, head = plan.detections.n_frames, _empty_result(plan)
    spans = list(ranges(n_frames, CHUNK_FRAMES))
    done = runner.run(measure_piece, "measured", (partial(piece_of, plan, *span) for span in spans))
    parts = (
        _with_people_bodies(plan, runner.folder.load(name).to_reconstruction(head), span[0])
        for name, span in zip(done, spans, strict=True)
    )
    if plan.bodies is not None:
        parts = _with_subject_body(plan, parts)
    if plan.solver is not None:
        solver, size = plan.solver, max(BLOCK_FRAMES, plan.solver.margin)
        windows = frame_windows(parts, n_frames, solver.margin, size)
        names = runner.run(solve_piece, "solved", (partial(solver.restricted_to, window) for window in windows))
        parts = (runner.folder.load(name).to_reconstruction(head) for name in names)
    if plan.alignment is not None:
        parts = align_parts(parts, plan.alignment)
    yield from report_ranges(parts, n_frames, "assembling", progress)


def track_piece(path: Path) -> None:
    """Track people through a window."""
    folder, piece = _read(path)
    folder.save(path.stem, track_window(*piece))


def measure_piece(path: Path) -> None:
    """Measure a range of frames."""
    folder, piece = _read(path)
    assert isinstance(piece, Piece)
    folder.save(path.stem, measure_range(piece))


def solve_piece(path: Path) -> None:
    """Solve a block of frames over time."""
    folder, (solver, window) = _read(path)
    assert isinstance(solver, LayerSolver)
    folder.save(path.stem, FrameRange.of(solver.solve_window(window)))


def _read(path: Path) -> tuple[CheckpointFolder, Any]:
    """Return where the result of a piece is stored, and the piece."""
    key, piece = pickle.loads(path.read_bytes())
    return CheckpointFolder(path.parent, key), piece


def _track_windows(
    rig: CameraRig, detections: Detections, options: Options, runner: PieceRunner, progress: Progress
) -> StitchedPeople:
    """Track people in all windows and stitch them."""
    skeleton, fixed = shared_settings(rig, detections, options)
    rate_hz = 1.0 / clock_of(detections).period_s
    windows = tracking_windows(detections.n_frames, rate_hz, runner.workers.window_s, options.tracker.terminate_after_s)
    starts = [window.first for window in windows]
    trackers = save_trackers(rig, replace(detections, skeleton=skeleton), fixed, starts, progress, runner.folder)

    def piece(window: TrackingWindow, tracker: str) -> tuple[Any, ...]:
        frames = replace(detections.frames(window.first, window.last), skeleton=skeleton)
        return rig, frames, fixed, window, runner.folder.load(tracker)

    pieces = (partial(piece, *each) for each in zip(windows, trackers, strict=True))
    done = runner.run(track_piece, "tracked", pieces)
    tracked: list[TrackedWindow] = [runner.folder.load(name)[0] for name in done]
    people = stitch(tracked, detections.frame_numbers, _LoadedBodies(runner.folder, done))
    return people.only(options.person) if options.person else people


class _LoadedBodies:
    """Loads the bodies of windows in order; the last window stays in memory."""

    def __init__(self, folder: CheckpointFolder, names: Sequence[str]) -> None:
        self._folder, self._names = folder, names
        self._last: tuple[int, WindowBodies] | None = None

    def __call__(self, window: int) -> WindowBodies:
        if self._last is None or self._last[0] != window:
            self._last = window, self._folder.load(self._names[window])[1]
        return self._last[1]


def _empty_result(plan: Plan) -> Reconstruction:
    """Return the result without frames: what all its ranges share."""
    head, subjects = empty_result(plan), plan.subjects
    if not isinstance(subjects, StitchedPeople):
        return head
    head = replace(head, events=subjects.events)
    return head if plan.options.bodies == "none" else replace(head, skeleton=subjects.skeleton)


def _with_people_bodies(plan: Plan, part: Reconstruction, start: int) -> Reconstruction:
    """Return a measured range with the bodies of tracked people."""
    subjects = plan.subjects
    if isinstance(subjects, StitchedPeople) and plan.options.bodies != "none":
        part = subjects.with_bodies(part, start)
        assert part.poses is not None
        # The people were tracked before the up direction was inferred.
        part = replace(part, poses=with_root_angle_sds(part.poses, part.rig.up))
        frames = plan.detections.frames(start, start + part.n_frames)
        part = with_deviations(part, frames, plan.deviation_sd_m)
    return part


def _with_subject_body(plan: Plan, parts: Iterator[Reconstruction]) -> Iterator[Reconstruction]:
    """Return ranges with the body of a single subject."""
    assert plan.bodies is not None
    assert isinstance(plan.subjects, SingleSubject)
    smoother, start = plan.bodies.smoother(), 0
    for part in parts:
        stop = start + part.n_frames
        frames = plan.detections.frames(start, stop)
        layer, poses = plan.bodies.bodies(plan.rig, frames, start, smoother.take(stop))
        part = replace(part, poses=poses, layers={**part.layers, "model": layer})
        yield with_deviations(part, frames, plan.deviation_sd_m)
        start = stop
