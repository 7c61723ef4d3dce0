"""Reconstruct a long recording in pieces that other processes or machines run.

The caller determines everything that depends on the whole recording; it tracks many people through all frames and
stores the tracker before each window. Three rounds of independent pieces follow: ranges of frames are measured, bodies
are smoothed in windows, and blocks of frames are solved over time. Tracks, measured and solved points and fitted bodies
equal those of an undivided run.

A piece is a file in a folder that all workers share, with its result beside it as a part of a
:class:`posefuse.io.checkpoints.CheckpointFolder`. An interrupted run resumes from the finished pieces.
"""

import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from posefuse.alignment.apply import align_parts
from posefuse.arrays import ranges
from posefuse.association.one_subject import SingleSubject
from posefuse.checkpoint import Checkpoint
from posefuse.errors import FileError
from posefuse.io.checkpoints import CheckpointFolder
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.layer_statuses import with_true_statuses
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.result_ranges import FrameRange
from posefuse.model.subjects import Subjects
from posefuse.model.track_events import Poses
from posefuse.pipeline.defaults import BLOCK_FRAMES
from posefuse.pipeline.measured_layer import Piece, measure_range, piece_of
from posefuse.pipeline.people.find_subjects import find_subjects
from posefuse.pipeline.people.keypoint_deviations import with_deviations
from posefuse.pipeline.people.track_recording import frame_times
from posefuse.pipeline.people.tracked_people import TrackedPeople
from posefuse.pipeline.people.windows import (
    DividedPeople,
    Window,
    WindowBodies,
    WindowPiece,
    smooth_window,
    windows_of,
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
        window_s: approximate length of a window whose bodies are smoothed, in seconds.
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

    def result(self, name: str) -> Any:
        """Return the result of a piece.

        Raises:
            FileError: if it is missing or damaged.
        """
        found = self.folder.load(name)
        if found is None:
            raise FileError(
                f"The result {name} of a worker is missing in {self.folder.folder}, or it is damaged. All workers must "
                "see this folder under the same path. Run the same command again: it computes only what is missing."
            )
        return found


def is_long(detections: Detections, options: Options, window_s: float) -> bool:
    """Return whether a recording has times, and frames for two windows."""
    rate_hz = detections.rate_hz or options.rate_hz
    return rate_hz is not None and detections.n_frames >= 2.0 * window_s * rate_hz


def prepare_distributed(
    rig: CameraRig, detections: Detections, options: Options, runner: PieceRunner, progress: Progress
) -> Plan:
    """Prepare a plan as :func:`posefuse.pipeline.reconstruct.prepare` does, for people whose bodies are divided.

    Raises:
        MatchError: if views and cameras do not match.
        DetectionsError: if the detections do not allow what the options ask for.
    """

    def find(
        rig: CameraRig, detections: Detections, options: Options, progress: Progress, checkpoint: Checkpoint
    ) -> tuple[Subjects, TrackedPeople | None]:
        if options.people != "many":
            return find_subjects(rig, detections, options, progress)
        rate_hz = 1.0 / clock_of(detections).period_s
        windows = tuple(windows_of(frame_times(detections), rate_hz, runner.workers.window_s, options))
        starts = [window.first for window in windows]
        people, bodies = find_subjects(rig, detections, options, progress, checkpoint, stored=starts)
        assert isinstance(people, TrackedPeople)
        if people.n_frames < detections.n_frames:  # interrupted: a divided recording has no partial result
            raise KeyboardInterrupt
        if bodies is None:
            return people, None
        divided = DividedPeople.of(people, detections, options, windows, checkpoint)
        return divided, divided

    plan = prepare(rig, detections, options, progress, runner.folder, find)
    if not isinstance(plan.bodies, DividedPeople):
        return plan
    number = len(plan.bodies.windows)
    note = (
        f"Bodies were smoothed in {number} window{'s' * (number > 1)} of about {runner.workers.window_s:g} s, with "
        "priors of the whole recording."
    )
    return replace(plan, provenance=plan.provenance.with_notes((note,)))


def reconstruct_distributed(plan: Plan, runner: PieceRunner, progress: Progress) -> Iterator[Reconstruction]:
    """Carry out a plan from :func:`prepare_distributed`, in consecutive ranges of frames.

    The body of a single subject is smoothed by the caller, since its smoother runs through the recording once.
    """
    n_frames, head = plan.detections.n_frames, empty_result(plan)
    spans = list(ranges(n_frames, plan.options.chunk_frames))
    done = runner.run(measure_piece, "measured", (partial(piece_of, plan, *span) for span in spans))
    parts = (runner.result(name).to_reconstruction(head) for name in done)
    if isinstance(plan.bodies, DividedPeople):
        parts = _with_people_bodies(plan, plan.bodies, parts, runner)
    elif plan.bodies is not None:
        parts = _with_subject_body(plan, parts)
    if plan.solver is not None:
        solver, size = plan.solver, max(BLOCK_FRAMES, plan.solver.margin)
        windows = frame_windows(parts, n_frames, solver.margin, size)
        names = runner.run(solve_piece, "solved", (partial(solver.restricted_to, window) for window in windows))
        parts = (runner.result(name).to_reconstruction(head) for name in names)
    if plan.alignment is not None:
        parts = align_parts(parts, plan.alignment)
    yield from report_ranges(parts, n_frames, "assembling", progress)


def measure_piece(path: Path) -> None:
    """Measure a range of frames."""
    folder, piece = _read(path)
    assert isinstance(piece, Piece)
    folder.save(path.stem, measure_range(piece))


def smooth_piece(path: Path) -> None:
    """Smooth the bodies of a window."""
    folder, piece = _read(path)
    assert isinstance(piece, WindowPiece)
    folder.save(path.stem, smooth_window(piece))


def solve_piece(path: Path) -> None:
    """Solve a block of frames over time."""
    folder, (solver, window) = _read(path)
    assert isinstance(solver, LayerSolver)
    folder.save(path.stem, FrameRange.of(solver.solve_window(window)))


def _read(path: Path) -> tuple[CheckpointFolder, Any]:
    """Return where the result of a piece is stored, and the piece."""
    key, piece = pickle.loads(path.read_bytes())
    return CheckpointFolder(path.parent, key), piece


def _with_people_bodies(
    plan: Plan, people: DividedPeople, parts: Iterator[Reconstruction], runner: PieceRunner
) -> Iterator[Reconstruction]:
    """Return measured ranges, each within one window, with the bodies of tracked people."""
    priors, windows = people.shared_priors(), people.windows
    pieces = (partial(people.window_piece, window, priors, plan.rig, plan.detections) for window in windows)
    names = runner.run(smooth_piece, "bodies", pieces)
    bodies, start = _StoredBodies(runner, dict(zip(windows, names, strict=True))), 0
    for part in parts:
        stop = start + part.n_frames
        layer, poses = bodies.frames(start, stop)
        part = replace(part, layers={**part.layers, "model": with_true_statuses(layer)}, poses=poses)
        yield with_deviations(part, plan.detections.frames(start, stop), plan.deviation_sd_m)
        start = stop


class _StoredBodies:
    """Loads the bodies of windows in order; the last window stays in memory.

    Args:
        runner: has run :func:`smooth_piece`.
        names: names of the results.
    """

    def __init__(self, runner: PieceRunner, names: Mapping[Window, str]) -> None:
        self._runner, self._names = runner, names
        self._last: tuple[Window, WindowBodies] | None = None

    def frames(self, start: int, stop: int) -> WindowBodies:
        """Return the model layer and the poses of a range of frames."""
        layers, poses = [], []
        for window in self._names:
            first, last = max(window.start, start) - window.start, min(window.stop, stop) - window.start
            if first < last:
                if self._last is None or self._last[0] != window:
                    self._last = window, self._runner.result(self._names[window])
                layer, some = self._last[1]
                layers.append(layer.frames(first, last))
                poses.append(some.frames(first, last))
        return Layer.concatenate(layers), Poses.concatenate(poses)


def _with_subject_body(plan: Plan, parts: Iterator[Reconstruction]) -> Iterator[Reconstruction]:
    """Return ranges with the body of a single subject."""
    assert plan.bodies is not None
    assert isinstance(plan.subjects, SingleSubject)
    smoother, start = plan.bodies.smoother(), 0
    for part in parts:
        stop = start + part.n_frames
        frames = plan.detections.frames(start, stop)
        layer, poses = plan.bodies.bodies(plan.rig, frames, start, smoother.take(stop))
        part = replace(part, poses=poses, layers={**part.layers, "model": with_true_statuses(layer)})
        yield with_deviations(part, frames, plan.deviation_sd_m)
        start = stop
