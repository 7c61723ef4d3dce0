"""A long recording reconstructed in pieces by whoever has time: the recipe of a cluster.

Three rounds, each of pieces that know nothing of each other: people are followed window by window (many people alone;
of one subject that takes no time), points are measured range by range, and solved over time block by block. Between
them the windows' people are made one, and everything that depends on the whole recording is settled. Points are those
of a run in one go, if people are.

Pieces are files of a folder that all can see: what is to be done, and beside it what came of it.
"""

import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from posefuse.alignment.apply import laid
from posefuse.arrays import ranges
from posefuse.association.one_subject import OneSubject
from posefuse.association.subjects import Subjects
from posefuse.following.followed import Followed
from posefuse.following.stitching import Stitched, stitch
from posefuse.following.windows import Bodies, Seen, Window, agreed, follow_window, windows_of
from posefuse.measuring import Plan, context_frames, measure
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import CHUNK_FRAMES, Detections
from posefuse.model.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.tracks import Tracks
from posefuse.pipeline import prepare, who_is_followed
from posefuse.progress import Progress, watched
from posefuse.solving import BLOCK_FRAMES, Solver, clock_of, windows


class Do(Protocol):
    """Does pieces side by side, in other processes or on other machines."""

    def __call__(self, work: Callable[[Path], None], pieces: Sequence[Path], /) -> None:
        """Have ``work`` done for each piece, until all are done."""
        ...


@dataclass(frozen=True)
class Team:
    """Whoever does the pieces, and where these lie.

    Attributes:
        folder: for them alone; whoever does them sees it under the same path.
        do: has them done.
        window_s: about how long a window is.
    """

    folder: Path
    do: Do
    window_s: float

    def round(self, work: Callable[[Path], None], name: str, pieces: Iterator[Any]) -> list[Path]:
        """Have pieces of one kind done; where what came of each is."""
        paths = []
        for i, piece in enumerate(pieces):
            paths.append(self.folder / f"{name}_{i:05d}.todo")
            _write(paths[-1], piece)
        self.do(work, paths)
        for path in paths:
            path.unlink()
        return [path.with_suffix(".done") for path in paths]


@dataclass(frozen=True, eq=False)
class Given:
    """Whose detections are whose, known."""

    tracks: Tracks

    def follow(self, start: int, stop: int) -> Tracks:
        """Who is whose in a range of frames."""
        return self.tracks.frames(start, stop)


def is_long(detections: Detections, options: Options, window_s: float) -> bool:
    """Whether a recording has frames enough for two windows, and times."""
    rate_hz = detections.rate_hz or options.rate_hz
    return rate_hz is not None and detections.n_frames >= 2.0 * window_s * rate_hz


def prepare_divided(rig: CameraRig, detections: Detections, options: Options, team: Team, progress: Progress) -> Plan:
    """As :func:`posefuse.pipeline.prepare`, with people followed window by window.

    Raises:
        MatchError: if views and cameras do not belong together.
        DetectionsError: if the detections do not allow what the options ask for.
    """

    def who(
        rig: CameraRig, detections: Detections, options: Options, progress: Progress
    ) -> tuple[Subjects, Followed | None]:
        if options.people != "many":
            return who_is_followed(rig, detections, options, progress)
        return _followed(rig, detections, options, team), None

    plan = prepare(rig, detections, options, progress, who=who)
    if not isinstance(plan.subjects, Stitched):
        return plan
    number, beside_s = len(plan.subjects.starts) - 1, options.tracker.forget_after_s
    note = (
        f"People were followed in {number} windows of about {team.window_s:g} s, each with more than {beside_s:g} s on "
        "either side, and made one by their detections there."
    )
    return replace(plan, provenance=plan.provenance.with_notes((note,)))


def reconstruct_divided(plan: Plan, team: Team, progress: Progress) -> Iterator[Reconstruction]:
    """As :func:`posefuse.measuring.reconstruct_chunks`, of a plan from :func:`prepare_divided`.

    The one subject's body, if there is one, is given by its smoother, which goes through the recording once.
    """
    n_frames = plan.detections.n_frames
    spans = list(ranges(n_frames, CHUNK_FRAMES))
    done = team.round(measure_piece, "measured", (_alone(plan, *span) for span in spans))
    parts = (_whole(plan, _taken(path), start) for path, (start, _) in zip(done, spans, strict=True))
    if plan.bodies is not None:
        parts = _with_body(plan, parts)
    if plan.solver is not None:
        solver, size = plan.solver, max(BLOCK_FRAMES, plan.solver.margin)
        pieces = (solver.alone(window) for window in windows(iter(parts), n_frames, solver.margin, size))
        parts = (_taken(path) for path in team.round(solve_piece, "solved", pieces))
    if plan.alignment is not None:
        parts = laid(parts, plan.alignment)
    yield from watched(parts, n_frames, "putting together", progress)


def follow_piece(path: Path) -> None:
    """Follow everybody through a window."""
    seen, bodies = follow_window(*_read(path))
    _write(path.with_suffix(".bodies"), bodies)
    _write(path.with_suffix(".done"), seen)


def measure_piece(path: Path) -> None:
    """Measure a range of frames."""
    _write(path.with_suffix(".done"), measure(*_read(path)))


def solve_piece(path: Path) -> None:
    """Solve a block of frames over time."""
    solver, window = _read(path)
    assert isinstance(solver, Solver)
    _write(path.with_suffix(".done"), solver.solved(window))


def _followed(rig: CameraRig, detections: Detections, options: Options, team: Team) -> Stitched:
    """Everybody, of all windows."""
    skeleton, fixed = agreed(rig, detections, options)
    rate_hz = 1.0 / clock_of(detections).period_s
    spans = windows_of(detections.n_frames, rate_hz, team.window_s, options.tracker.forget_after_s)

    def piece(window: Window) -> tuple[CameraRig, Detections, Options, Window]:
        return rig, replace(detections.frames(window.first, window.last), skeleton=skeleton), fixed, window

    done = team.round(follow_piece, "followed", map(piece, spans))
    seen: list[Seen] = [_taken(path) for path in done]
    found = stitch(seen, detections.frame_numbers, _Bodies(tuple(path.with_suffix(".bodies") for path in done)))
    return found.only(options.person) if options.person else found


class _Bodies:
    """Reads the bodies of windows, which are wanted in order: the last is at hand."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = paths
        self._last: tuple[int, Bodies] | None = None

    def __call__(self, window: int) -> Bodies:
        if self._last is None or self._last[0] != window:
            self._last = window, _read(self._paths[window])
        return self._last[1]


def _alone(plan: Plan, start: int, stop: int) -> tuple[Plan, int, int]:
    """A plan that knows a range of frames and what it looks at around it, and where the range is in that."""
    around = context_frames(plan)
    first, last = max(start - around, 0), min(stop + around, plan.detections.n_frames)
    subjects = Given(plan.subjects.follow(first, last))
    part = replace(
        plan, detections=plan.detections.frames(first, last), subjects=subjects, bodies=None, solver=None,
        alignment=None,
    )  # fmt: skip
    return part, start - first, stop - first


def _whole(plan: Plan, part: Reconstruction, start: int) -> Reconstruction:
    """A measured range with what is known of the whole recording: the bodies of many, and what happened to them."""
    subjects = plan.subjects
    if not isinstance(subjects, Stitched):
        return part
    part = replace(part, events=subjects.events)
    return part if plan.options.bodies == "none" else subjects.with_bodies(part, start)


def _with_body(plan: Plan, parts: Iterator[Reconstruction]) -> Iterator[Reconstruction]:
    """Ranges with the one subject's body."""
    assert plan.bodies is not None
    assert isinstance(plan.subjects, OneSubject)
    smoother, start = plan.bodies.smoother(), 0
    for part in parts:
        stop = start + part.n_frames
        seen = plan.detections.frames(start, stop)
        layer, poses = plan.bodies.bodies(plan.rig, seen, start, smoother.take(stop))
        known = replace(part, skeleton=plan.bodies.skeleton, poses=poses, events=plan.bodies.events)
        yield replace(known, layers={**part.layers, "model": layer})
        start = stop


def _write(path: Path, value: object) -> None:
    """Whole or not at all: somebody else may do the same piece."""
    temporary = path.with_suffix(f"{path.suffix}.partial")
    temporary.write_bytes(pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL))
    temporary.replace(path)


def _read(path: Path) -> Any:
    return pickle.loads(path.read_bytes())


def _taken(path: Path) -> Any:
    """What came of a piece, which is needed once."""
    value = _read(path)
    path.unlink()
    return value
