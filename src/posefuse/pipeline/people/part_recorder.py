"""Track hands and faces through a recording behind the bodies, and record them."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Any

import numpy as np

from posefuse.checkpoint import Checkpoint, Spool
from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.parallel import Jobs
from posefuse.tracking.body_frames import BodyFrame
from posefuse.tracking.history import History
from posefuse.tracking.parts import PartTracker

BodyFrames = tuple[Detections, np.ndarray, Sequence[BodyFrame]]
"""Detections of some frames, their times, shape (frame,), and the bodies in each of them."""


class PartRecorder:
    """Tracker of one part of all people, and the record of its output.

    Args:
        tracker: tracker before the first frame.
        spool: stores states that are not needed before the end; None to use a temporary file.
    """

    def __init__(self, tracker: PartTracker, spool: Spool | None) -> None:
        self.tracker = tracker
        self.history = History(tracker.settings, spool, has_past=False)
        self.shapes: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        """By name, the lengths and their standard deviations, shape (shape,) each."""
        self.done = 0
        """Number of frames processed."""

    def follow(self, frames: BodyFrames) -> None:
        """Track the part through more frames."""
        chunk, times_s, bodies = frames
        for frame, each in zip(frames_of(chunk, times_s), bodies, strict=True):
            self.tracker.update(frame, each)
            self.history.add_parts(self.tracker, each)
            self.shapes |= {name: self.tracker.shape_of(name) for name in each.names}
        self.done += len(bodies)


def frames_of(chunk: Detections, times_s: np.ndarray) -> Iterator[Frame]:
    """Yield the frames; ``times_s``, shape (frame,), is used where no view recorded the frame."""
    for i in range(chunk.n_frames):
        frame = Frame.of(chunk, i)
        if not frame.recorded.any():
            frame = replace(frame, time_s=np.full(len(frame.recorded), times_s[i]))
        yield frame


def load_parts(checkpoint: Checkpoint, number: int) -> list[PartRecorder] | None:
    """Return the recorders of all parts that were saved last, or None if one of them is missing."""
    loaded = [checkpoint.load(_name(i)) for i in range(number)]
    if None in loaded:
        return None
    for recorder, spool in zip(loaded, part_spools(checkpoint, number), strict=True):
        recorder.history.attach_spool(spool)
    return loaded


def part_spools(checkpoint: Checkpoint, number: int) -> list[Spool | None]:
    """Return the spools of the histories of all parts."""
    return [checkpoint.spool(f"{_name(i)}.states") for i in range(number)]


def _name(i: int) -> str:
    return f"tracking_part_{i}"


class PartFollower:
    """Passes bodies on to the recorders of hands and faces: in other processes if there are any, else in this one.

    Args:
        recorders: the recorders.
        checkpoint: stores the states of the recorders.
        jobs: processes that work while the next bodies are tracked.
    """

    def __init__(self, recorders: list[PartRecorder], checkpoint: Checkpoint, jobs: Jobs) -> None:
        self._recorders, self._checkpoint, self._jobs = recorders, checkpoint, jobs
        self._spools = part_spools(checkpoint, len(recorders))
        self._working: dict[int, Callable[[], PartRecorder]] = {}
        """By index of the part, functions that wait for its recorder; each is to be called once."""
        self._saving: Future[None] | None = None

    def follow(self, first: int, frames: BodyFrames) -> None:
        """Pass more frames on; ``first`` is the index of the first of them.

        A recorder from a checkpoint skips frames that it has processed already.
        """
        recorders = self.wait()
        behind = [i for i, recorder in enumerate(recorders) if recorder.done <= first]
        if self._jobs.number == 1 or None in self._spools:
            for i in behind:
                recorders[i].follow(frames)
        else:
            for i in behind:
                self._working[i] = self._jobs.begin(_follow_elsewhere, (recorders[i], self._spools[i], frames))

    def wait(self) -> list[PartRecorder]:
        """Wait until all frames are processed, and a save that has begun is complete; return the recorders."""
        if self._saving is not None:
            self._saving.result()
            self._saving = None
        self._finish()
        return self._recorders

    def save(self) -> None:
        """Wait until all frames are processed, and store the recorders."""
        self._finish()
        for i, recorder in enumerate(self._recorders):
            self._replace(i, self._checkpoint.save(_name(i), recorder))

    def begin_save(self, thread: Executor) -> Executor:
        """Do the same in a thread; return an executor for work in this thread that needs its success."""
        self._saving = thread.submit(self.save)
        return _After(self._saving, thread)

    def _finish(self) -> None:
        # An interruption may end this loop; the next call continues it.
        while self._working:
            i = next(iter(self._working))
            self._replace(i, self._working.pop(i)())

    def _replace(self, i: int, recorder: PartRecorder) -> None:
        """Continue with a copy of a recorder."""
        spool = self._spools[i]
        if spool is not None:
            recorder.history.attach_spool(spool)
        self._recorders[i] = recorder


class _After(Executor):
    """Runs work in a thread if work that was submitted to the same thread before has succeeded."""

    def __init__(self, before: Future[None], thread: Executor) -> None:
        self._before, self._thread = before, thread

    def submit(self, fn: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        """Submit work to the thread."""

        def work() -> Any:
            self._before.result()
            return fn(*arguments, **named)

        return self._thread.submit(work)


def _follow_elsewhere(given: tuple[PartRecorder, Spool | None, BodyFrames]) -> PartRecorder:
    recorder, spool, frames = given
    assert spool is not None
    recorder.history.attach_spool(spool)
    recorder.follow(frames)
    return recorder
