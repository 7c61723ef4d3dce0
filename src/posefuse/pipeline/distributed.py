"""A long recording reconstructed in pieces by whoever has time: the recipe of a cluster.

First everybody is followed once, by the caller (many people alone; of one subject that takes no time), and the tracker
kept before each window. Then three rounds, each of pieces that know nothing of each other: windows are followed from
there and bodies smoothed, points are measured range by range, and solved over time block by block. Between them the
windows' people are made one, and everything that depends on the whole recording is settled. Measured points are those
of a run in one go.

Pieces are files of a folder that all can see: what is to be done, and beside it what came of it, a part as
:mod:`posefuse.io.checkpoints` keeps it: work that was ended goes on from the pieces that are done.
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
from posefuse.io.checkpoints import CheckpointFolder
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import CHUNK_FRAMES, Detections
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.result_ranges import Piece
from posefuse.model.subjects import Subjects
from posefuse.model.tracks import Tracks
from posefuse.pipeline.measured_layer import Plan, context_frames, head_of, measure
from posefuse.pipeline.people.stitching import StitchedPeople, stitch
from posefuse.pipeline.people.track_recording import keep_trackers
from posefuse.pipeline.people.tracked_people import TrackedPeople
from posefuse.pipeline.people.windows import Bodies, Seen, Window, agreed, follow_window, windows_of
from posefuse.pipeline.reconstruct import prepare, who_is_followed
from posefuse.pipeline.solved_layer import BLOCK_FRAMES, Solver, clock_of, windows
from posefuse.progress import Progress, watched


class Do(Protocol):
    """Does pieces side by side, in other processes or on other machines."""

    def __call__(self, work: Callable[[Path], None], pieces: Sequence[Path], /) -> None:
        """Have ``work`` done for each piece, until all are done."""
        ...


@dataclass(frozen=True)
class Team:
    """Whoever does the pieces, and where these lie.

    Attributes:
        parts: where pieces lie; whoever does them sees the folder under the same path.
        do: has them done.
        window_s: about how long a window is.
    """

    parts: CheckpointFolder
    do: Do
    window_s: float

    def round(self, work: Callable[[Path], None], name: str, pieces: Iterable[Callable[[], Any]]) -> list[str]:
        """Have pieces of one kind done, but for those that are; the names of the parts that come of each."""
        names, todo = [], []
        self.parts.begin()
        for i, piece in enumerate(pieces):
            names.append(f"{name}_{i:05d}")
            if self.parts.load(names[-1]) is None:
                todo.append(self.parts.folder / f"{names[-1]}.todo")
                todo[-1].write_bytes(pickle.dumps((self.parts.key, piece()), protocol=pickle.HIGHEST_PROTOCOL))
        self.do(work, todo)
        for path in todo:
            path.unlink()
        return names


@dataclass(frozen=True, eq=False)
class Given:
    """Whose detections are whose, known."""

    recording_tracks: Tracks

    def tracks(self, start: int, stop: int) -> Tracks:
        """Who is whose in a range of frames."""
        return self.recording_tracks.frames(start, stop)


def is_long(detections: Detections, options: Options, window_s: float) -> bool:
    """Whether a recording has frames enough for two windows, and times."""
    rate_hz = detections.rate_hz or options.rate_hz
    return rate_hz is not None and detections.n_frames >= 2.0 * window_s * rate_hz


def prepare_divided(rig: CameraRig, detections: Detections, options: Options, team: Team, progress: Progress) -> Plan:
    """As :func:`posefuse.pipeline.reconstruct.prepare`, with people followed window by window.

    Raises:
        MatchError: if views and cameras do not belong together.
        DetectionsError: if the detections do not allow what the options ask for.
    """

    def who(
        rig: CameraRig, detections: Detections, options: Options, progress: Progress
    ) -> tuple[Subjects, TrackedPeople | None]:
        if options.people != "many":
            return who_is_followed(rig, detections, options, progress)
        return _followed(rig, detections, options, team, progress), None

    plan = prepare(rig, detections, options, progress, who=who)
    if not isinstance(plan.subjects, StitchedPeople):
        return plan
    number, beside_s = len(plan.subjects.starts) - 1, options.tracker.terminate_after_s
    note = (
        f"People were followed in {number} windows of about {team.window_s:g} s, each from where the tracker had come "
        f"and to more than {beside_s:g} s after it, and made one by their detections there."
    )
    return replace(plan, provenance=plan.provenance.with_notes((note,)))


def reconstruct_divided(plan: Plan, team: Team, progress: Progress) -> Iterator[Reconstruction]:
    """As :func:`posefuse.pipeline.measured_layer.reconstruct_chunks`, of a plan from :func:`prepare_divided`.

    The one subject's body, if there is one, is given by its smoother, which goes through the recording once.
    """
    n_frames, head = plan.detections.n_frames, _head(plan)
    spans = list(ranges(n_frames, CHUNK_FRAMES))
    done = team.round(measure_piece, "measured", (partial(_alone, plan, *span) for span in spans))
    parts = (
        _whole(plan, team.parts.load(name).of_result(head), span[0]) for name, span in zip(done, spans, strict=True)
    )
    if plan.bodies is not None:
        parts = _with_body(plan, parts)
    if plan.solver is not None:
        solver, size = plan.solver, max(BLOCK_FRAMES, plan.solver.margin)
        pieces = (partial(solver.alone, window) for window in windows(parts, n_frames, solver.margin, size))
        parts = (team.parts.load(name).of_result(head) for name in team.round(solve_piece, "solved", pieces))
    if plan.alignment is not None:
        parts = align_parts(parts, plan.alignment)
    yield from watched(parts, n_frames, "putting together", progress)


def follow_piece(path: Path) -> None:
    """Follow everybody through a window."""
    parts, piece = _read(path)
    parts.save(path.stem, follow_window(*piece))


def measure_piece(path: Path) -> None:
    """Measure a range of frames."""
    parts, piece = _read(path)
    parts.save(path.stem, Piece.of(measure(*piece)))


def solve_piece(path: Path) -> None:
    """Solve a block of frames over time."""
    parts, (solver, window) = _read(path)
    assert isinstance(solver, Solver)
    parts.save(path.stem, Piece.of(solver.solved(window)))


def _read(path: Path) -> tuple[CheckpointFolder, Any]:
    """What is to be done, and where what comes of it is kept."""
    key, piece = pickle.loads(path.read_bytes())
    return CheckpointFolder(path.parent, key), piece


def _followed(
    rig: CameraRig, detections: Detections, options: Options, team: Team, progress: Progress
) -> StitchedPeople:
    """Everybody, of all windows."""
    skeleton, fixed = agreed(rig, detections, options)
    rate_hz = 1.0 / clock_of(detections).period_s
    spans = windows_of(detections.n_frames, rate_hz, team.window_s, options.tracker.terminate_after_s)

    places = [window.first for window in spans]
    trackers = keep_trackers(rig, replace(detections, skeleton=skeleton), fixed, places, progress, team.parts)

    def piece(window: Window, tracker: str) -> tuple[Any, ...]:
        theirs = replace(detections.frames(window.first, window.last), skeleton=skeleton)
        return rig, theirs, fixed, window, team.parts.load(tracker)

    pieces = (partial(piece, *each) for each in zip(spans, trackers, strict=True))
    done = team.round(follow_piece, "followed", pieces)
    seen: list[Seen] = [team.parts.load(name)[0] for name in done]
    found = stitch(seen, detections.frame_numbers, _Bodies(team.parts, done))
    return found.only(options.person) if options.person else found


class _Bodies:
    """Reads the bodies of windows, which are wanted in order: the last is at hand."""

    def __init__(self, parts: CheckpointFolder, names: Sequence[str]) -> None:
        self._parts, self._names = parts, names
        self._last: tuple[int, Bodies] | None = None

    def __call__(self, window: int) -> Bodies:
        if self._last is None or self._last[0] != window:
            self._last = window, self._parts.load(self._names[window])[1]
        return self._last[1]


def _alone(plan: Plan, start: int, stop: int) -> tuple[Plan, int, int]:
    """A plan that knows a range of frames and what it looks at around it, and where the range is in that."""
    around = context_frames(plan)
    first, last = max(start - around, 0), min(stop + around, plan.detections.n_frames)
    subjects = Given(plan.subjects.tracks(first, last))
    part = replace(
        plan, detections=plan.detections.frames(first, last), subjects=subjects, bodies=None, solver=None,
        alignment=None,
    )  # fmt: skip
    return part, start - first, stop - first


def _head(plan: Plan) -> Reconstruction:
    """What all ranges of a result share, with no frames."""
    head, subjects = head_of(plan), plan.subjects
    if not isinstance(subjects, StitchedPeople):
        return head
    head = replace(head, events=subjects.events)
    return head if plan.options.bodies == "none" else replace(head, skeleton=subjects.skeleton)


def _whole(plan: Plan, part: Reconstruction, start: int) -> Reconstruction:
    """A measured range with the bodies of many."""
    subjects = plan.subjects
    if isinstance(subjects, StitchedPeople) and plan.options.bodies != "none":
        return subjects.with_bodies(part, start)
    return part


def _with_body(plan: Plan, parts: Iterator[Reconstruction]) -> Iterator[Reconstruction]:
    """Ranges with the one subject's body."""
    assert plan.bodies is not None
    assert isinstance(plan.subjects, SingleSubject)
    smoother, start = plan.bodies.smoother(), 0
    for part in parts:
        stop = start + part.n_frames
        seen = plan.detections.frames(start, stop)
        layer, poses = plan.bodies.bodies(plan.rig, seen, start, smoother.take(stop))
        yield replace(part, poses=poses, layers={**part.layers, "model": layer})
        start = stop
