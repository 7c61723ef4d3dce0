"""Many people followed through a recording: association and tracking wired together."""

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.arrays import ranges
from posefuse.checkpoint import NO_CHECKPOINT, Checkpoint
from posefuse.errors import PosefuseWarning
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import CHUNK_FRAMES, Detections
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.subjects import Subjects
from posefuse.model.tracks import Tracks
from posefuse.pipeline.people.initial_noise import rough_noise
from posefuse.pipeline.people.recorder import Book
from posefuse.pipeline.people.tracked_people import TrackedPeople
from posefuse.pipeline.people.trackers import tracker_of, with_tree
from posefuse.preprocess.timeline import fill_missing_times
from posefuse.progress import Progress
from posefuse.tracking.history import History
from posefuse.tracking.records import TrackedFrame
from posefuse.tracking.tracker import ArticulatedTracker

_NEVER_S = 1e9
_SURE_LOG_ODDS = 1e9
_ANYWHERE = 1e9
_NAME = "following"
_TRACKER = "tracker_{:08d}"
_BOOK = f"{_NAME}.book"
_INTERRUPTED = "Interrupted: people were followed through {} of {} frames; the result is of those. Ctrl-C again stops."


def track_subject(
    rig: CameraRig,
    detections: Detections,
    subject: Subjects,
    options: Options,
    progress: Progress,
    checkpoint: Checkpoint = NO_CHECKPOINT,
) -> TrackedPeople:
    """Fit a body to the one subject of a recording: followed like many, from their detections alone.

    Raises:
        DetectionsError: if frames have no times.
        SkeletonError: if the skeleton has no tree, and none can be measured.
    """
    pieces = ranges(detections.n_frames, CHUNK_FRAMES)
    tracks = Tracks.concatenate([subject.tracks(*piece) for piece in pieces])
    theirs = tracks.rows(detections)[:, 0]
    kept = theirs >= 0
    alone = replace(detections, offsets=np.concatenate([[0], np.cumsum(kept.ravel())]), **detections.rows(theirs[kept]))
    # Every person who appears is the subject.
    anywhere = replace(options.tracker.specification, reacquire_gate=_ANYWHERE)
    always = replace(options.tracker.reidentification, min_log_odds=-_SURE_LOG_ODDS)
    tracker = replace(
        options.tracker, max_people=1, terminate_after_s=_NEVER_S, reidentification=always, specification=anywhere
    )
    return track_people(rig, alone, replace(options, tracker=tracker), progress, checkpoint)


def track_people(
    rig: CameraRig,
    detections: Detections,
    options: Options,
    progress: Progress,
    checkpoint: Checkpoint = NO_CHECKPOINT,
    tracker: ArticulatedTracker | None = None,
) -> TrackedPeople:
    """Follow everybody through a recording.

    Args:
        rig: the cameras.
        detections: of the recording.
        options: of its reconstruction.
        progress: told how far the work is.
        checkpoint: keeps what is done of it every ``chunk_frames``. If it does, an interruption ends the recording there.
        tracker: that has followed everybody up to the first frame; a new one where it is left out.

    Raises:
        DetectionsError: if frames have no times.
        SkeletonError: if the skeleton has no tree, and none can be measured.
    """
    stage = _Stage.kept(checkpoint) or _Stage.first(rig, detections, options, checkpoint, tracker)
    progress.start("following people", detections.n_frames)
    progress.advance(stage.done)
    times_s = _times(detections)
    try:
        for start, stop in ranges(detections.n_frames, options.chunk_frames):
            if start >= stage.done:
                stage.go_on(detections.frames(start, stop), times_s[start:stop])
                stage = stage.keep(checkpoint)
                progress.advance(stop - start)
    except KeyboardInterrupt:
        kept = _Stage.kept(checkpoint)
        if kept is None or not checkpoint.enabled:
            raise
        stage = kept
        warnings.warn(_INTERRUPTED.format(stage.done, detections.n_frames), PosefuseWarning, stacklevel=2)
    progress.finish()
    return stage.book.close(detections.between(0, stage.done) if stage.done < detections.n_frames else detections)


def first_tracker(rig: CameraRig, detections: Detections, options: Options) -> ArticulatedTracker:
    """The tracker of a recording, before its first frame.

    Raises:
        SkeletonError: if the skeleton has no tree, and none can be measured.
    """
    noise = rough_noise(rig, detections, options)
    return tracker_of(rig, with_tree(rig, detections, noise, options), noise, options)


def keep_trackers(
    rig: CameraRig,
    detections: Detections,
    options: Options,
    places: Sequence[int],
    progress: Progress,
    checkpoint: Checkpoint,
) -> list[str]:
    """Go through a recording once, and keep the tracker as it is before each of some frames.

    What is kept from an earlier time is not made again.

    Args:
        rig: the cameras.
        detections: of the recording.
        options: of its reconstruction.
        places: of the frames, counted from 0, ascending.
        progress: told how far the work is.
        checkpoint: keeps the trackers.

    Returns:
        The names of the parts that they are.

    Raises:
        DetectionsError: if frames have no times.
        SkeletonError: if the skeleton has no tree, and none can be measured.
    """
    names = [_TRACKER.format(place) for place in places]
    known = [checkpoint.load(name) for name in names]
    tracker, done = first_tracker(rig, detections, options), 0
    times_s = _times(detections)
    progress.start("following people", places[-1])
    for name, place, kept in zip(names, places, known, strict=True):
        if kept is None:
            for start, stop in ranges(place - done, CHUNK_FRAMES):
                first, last = done + start, done + stop
                for _ in _track_frames(tracker, detections.frames(first, last), times_s[first:last]):
                    pass
            kept = checkpoint.save(name, tracker)
        progress.advance(place - done)
        tracker, done = kept, place
    progress.finish()
    return names


@dataclass(eq=False)
class _Stage:
    """How far the following of a recording is.

    Attributes:
        tracker: after the last frame.
        book: of all frames.
        done: how many frames.
    """

    tracker: ArticulatedTracker
    book: Book
    done: int = 0

    @classmethod
    def first(
        cls,
        rig: CameraRig,
        detections: Detections,
        options: Options,
        checkpoint: Checkpoint,
        tracker: ArticulatedTracker | None = None,
    ) -> "_Stage":
        """Before the first frame."""
        tracker = tracker or first_tracker(rig, detections, options)
        spools = [checkpoint.spool(name) for name in _spools(len(tracker.parts))]
        body, *parts = (part.settings for part in (tracker, *tracker.parts))
        parts = tuple(History(each, spool) for each, spool in zip(parts, spools[1:], strict=True))
        return cls(tracker, Book(History(body, spools[0]), parts, checkpoint.spool(_BOOK)))

    @classmethod
    def kept(cls, checkpoint: Checkpoint) -> "_Stage | None":
        """The last that was kept."""
        stage = checkpoint.load(_NAME)
        return None if stage is None else stage.going_on(checkpoint)

    def keep(self, checkpoint: Checkpoint) -> "_Stage":
        """Keep it; the same as whoever goes on from there has it."""
        self.book.put_away()
        stage = checkpoint.save(_NAME, self)
        return stage if stage is self else stage.going_on(checkpoint)

    def going_on(self, checkpoint: Checkpoint) -> "_Stage":
        """The same with its book and histories in the checkpoint's spools."""
        spool = checkpoint.spool(_BOOK)
        assert spool is not None
        self.book.goes_on_in(spool)
        histories = (self.book.history, *self.book.parts)
        for history, name in zip(histories, _spools(len(histories) - 1), strict=True):
            spool = checkpoint.spool(name)
            assert spool is not None
            history.attach_spool(spool)
        return self

    def go_on(self, chunk: Detections, times_s: np.ndarray) -> None:
        """Follow people through more frames, those at these times, shape (frame,)."""
        for tracked in _track_frames(self.tracker, chunk, times_s):
            self.book.enter(self.tracker, tracked)
        self.done += chunk.n_frames


def _track_frames(tracker: ArticulatedTracker, chunk: Detections, times_s: np.ndarray) -> Iterator[TrackedFrame]:
    """Everybody in each of some frames, those at these times, shape (frame,)."""
    for i in range(chunk.n_frames):
        frame = Frame.of(chunk, i)
        if not frame.recorded.any():
            frame = replace(frame, time_s=np.full(len(frame.recorded), times_s[i]))
        yield tracker.process(frame)


def _spools(parts: int) -> tuple[str, ...]:
    return (f"{_NAME}.body", *(f"{_NAME}.part_{i}" for i in range(parts)))


def _times(detections: Detections) -> np.ndarray:
    """Shape (frame,): when frames were; of those that no view recorded, when they should have been; NaN if unknown."""
    known = np.asarray(detections.recorded) & np.isfinite(detections.time_s)
    last = np.where(known, detections.time_s, -np.inf).max(axis=1)
    return fill_missing_times(np.where(np.isfinite(last), last, np.nan), detections.frame_numbers)
