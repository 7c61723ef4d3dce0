"""Track people through a recording."""

import itertools
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
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
from posefuse.parallel import ONE_JOB, Jobs
from posefuse.pipeline.people.initial_noise import initial_noise, sample_frames
from posefuse.pipeline.people.recorder import Recorder
from posefuse.pipeline.people.tracked_people import TrackedPeople
from posefuse.pipeline.people.trackers import tracker_of, with_tree
from posefuse.preprocess.timeline import fill_missing_times
from posefuse.progress import Progress
from posefuse.tracking.history import History
from posefuse.tracking.records import TrackedFrame
from posefuse.tracking.tracker import ArticulatedTracker

_NEVER_S = 1e9
_CERTAIN_LOG_ODDS = 1e9
_UNLIMITED_GATE = 1e9
_NAME = "tracking"
_RECORDER = f"{_NAME}.recorder"
_INTERRUPTED = (
    "Interrupted: people were tracked through {} of {} frames, and the result covers these. Press Ctrl-C again to stop "
    "at once."
)


def track_subject(
    rig: CameraRig,
    detections: Detections,
    subject: Subjects,
    options: Options,
    progress: Progress,
    checkpoint: Checkpoint = NO_CHECKPOINT,
    make_tracker: Callable[[Options], ArticulatedTracker] | None = None,
) -> TrackedPeople:
    """Fit a body to the single subject of a recording by tracking its detections.

    Args:
        rig: calibrated cameras.
        detections: detections of the recording.
        subject: assigns detections to the subject.
        options: options of the reconstruction.
        progress: receives the progress.
        checkpoint: stores the state of tracking.
        make_tracker: returns a tracker with options for a single subject; by default, one for this recording is made.

    Raises:
        DetectionsError: if frames have no times.
        SkeletonError: if the skeleton has no kinematic tree, and none can be measured.
    """
    pieces = ranges(detections.n_frames, CHUNK_FRAMES)
    tracks = Tracks.concatenate([subject.tracks(*piece) for piece in pieces])
    rows = tracks.rows(detections)[:, 0]
    assigned = rows >= 0
    offsets = np.concatenate([[0], np.cumsum(assigned.ravel())])
    alone = replace(detections, offsets=offsets, **detections.rows(rows[assigned]))
    # Any person who appears is the subject: the track is never forgotten and always re-acquired.
    anywhere = replace(
        options.tracker.specification,
        reacquire_gate=_UNLIMITED_GATE,
        terminate_variance_m2=None,
        terminate_outside_after_s=None,
    )
    always = replace(options.tracker.reidentification, min_log_odds=-_CERTAIN_LOG_ODDS)
    tracker = replace(
        options.tracker, max_people=1, terminate_after_s=_NEVER_S, reidentification=always, specification=anywhere
    )
    options = replace(options, tracker=tracker)
    made = None if make_tracker is None else make_tracker(options)
    found = track_people(rig, alone, options, progress, checkpoint, made)
    # Views that show several people have more detections than the tracker saw.
    index = np.where(np.asarray(found.recording_tracks.detection) >= 0, tracks.detection[: found.n_frames], -1)
    return replace(found, recording_tracks=replace(found.recording_tracks, detection=index))


def track_people(
    rig: CameraRig,
    detections: Detections,
    options: Options,
    progress: Progress,
    checkpoint: Checkpoint = NO_CHECKPOINT,
    tracker: ArticulatedTracker | None = None,
    jobs: Jobs = ONE_JOB,
    stored: Sequence[int] = (),
) -> TrackedPeople:
    """Track all people through a recording.

    Args:
        rig: calibrated cameras.
        detections: detections of the recording.
        options: options of the reconstruction.
        progress: receives the progress.
        checkpoint: stores the state every ``chunk_frames``. If it does, an interruption ends the recording there;
            :func:`warn_of_interruption` says so.
        tracker: tracker that has processed all frames before the first; a new one if it is None.
        jobs: with several, a thread reads ahead and another one stores.
        stored: indices of frames, in ascending order; the checkpoint stores the tracker as it is before each of them,
            under the name that :func:`tracker_name` returns. People are tracked again from the start if one of them is
            missing.

    Raises:
        DetectionsError: if frames have no times.
        SkeletonError: if the skeleton has no kinematic tree, and none can be measured.
    """
    times_s = frame_times(detections)
    stage = _Stage.load(checkpoint)
    if stage is None or any(checkpoint.load(tracker_name(place)) is None for place in stored if place <= stage.done):
        stage = _Stage.first(tracker or first_tracker(rig, detections, options), checkpoint)
        if 0 in stored:
            checkpoint.save(tracker_name(0), stage.tracker)
    progress.start("tracking people", detections.n_frames)
    progress.advance(stage.done)
    spans = [span for span in ranges(detections.n_frames, options.chunk_frames) if span[0] >= stage.done]
    with jobs.thread() as thread:
        store = _Store(checkpoint, thread)
        stage.attach(store)
        try:
            chunks = jobs.ahead(detections.frames(*span) for span in spans)
            for chunk, (start, stop) in zip(chunks, spans, strict=True):
                bounds = [start, *(place for place in stored if start < place <= stop), stop]
                for first, last in itertools.pairwise(bounds):
                    stage.advance(chunk.frames(first - start, last - start), times_s[first:last])
                    if last in stored:
                        checkpoint.save(tracker_name(last), stage.tracker)
                stage = store.save(stage)
                progress.advance(stop - start)
            store.wait()
        except KeyboardInterrupt:
            # A second interruption while the thread still works ends the run, and the next run resumes.
            store.wait()
            saved = _Stage.load(checkpoint)
            if saved is None or not checkpoint.enabled:
                raise
            stage = saved
    progress.finish()
    offsets = detections.offsets[: stage.done * detections.n_views + 1]
    return stage.recorder.close(offsets, detections.n_views)


def warn_of_interruption(people: TrackedPeople, detections: Detections) -> None:
    """Warn if tracking was interrupted, and the result will cover the frames before."""
    if people.n_frames < detections.n_frames:
        warnings.warn(_INTERRUPTED.format(people.n_frames, detections.n_frames), PosefuseWarning, stacklevel=3)


def continue_tracking(tracker: ArticulatedTracker, detections: Detections, times_s: np.ndarray) -> TrackedPeople:
    """Track all people through a range of frames of a recording.

    Args:
        tracker: tracker that has processed all earlier frames.
        detections: detections of the range.
        times_s: shape (frame,): times of its frames, from :func:`frame_times` of the recording.

    Raises:
        DetectionsError: if frames have no times.
    """
    stage = _Stage.first(tracker, NO_CHECKPOINT)
    for start, stop in ranges(detections.n_frames, CHUNK_FRAMES):
        stage.advance(detections.frames(start, stop), times_s[start:stop])
    return stage.recorder.close(detections.offsets, detections.n_views)


def first_tracker(rig: CameraRig, detections: Detections, options: Options) -> ArticulatedTracker:
    """Return the tracker of a recording, before its first frame.

    Raises:
        SkeletonError: if the skeleton has no kinematic tree, and none can be measured.
    """
    frames, skeleton = sample_frames(detections), detections.skeleton
    noise = initial_noise(rig, frames, skeleton, options)
    return tracker_of(rig, with_tree(rig, frames, skeleton, noise, options), noise, options)


def tracker_name(place: int) -> str:
    """Return the name under which a checkpoint stores the tracker as it is before the frame with this index."""
    return f"tracker_{place:08d}"


@dataclass(eq=False)
class _Stage:
    """The state of tracking between two chunks.

    Attributes:
        tracker: tracker after the last frame.
        recorder: record of all frames.
        done: number of frames processed.
    """

    tracker: ArticulatedTracker
    recorder: Recorder
    done: int = 0

    @classmethod
    def first(cls, tracker: ArticulatedTracker, checkpoint: Checkpoint) -> "_Stage":
        """Return the state before the first frame."""
        spools = [checkpoint.spool(name) for name in _spools(len(tracker.parts))]
        body, *parts = (part.settings for part in (tracker, *tracker.parts))
        parts = tuple(History(each, spool, has_past=False) for each, spool in zip(parts, spools[1:], strict=True))
        return cls(tracker, Recorder(History(body, spools[0]), parts, checkpoint.spool(_RECORDER)))

    @classmethod
    def load(cls, checkpoint: Checkpoint) -> "_Stage | None":
        """Return the last state that was saved, or None."""
        stage = checkpoint.load(_NAME)
        if stage is not None:
            stage.attach(_Store(checkpoint))
        return stage

    def attach(self, store: "_Store") -> None:
        """Let the recorder and its histories append to the spools of a checkpoint, if it has any."""
        histories = (self.recorder.history, *self.recorder.parts)
        spools = [store.checkpoint.spool(name) for name in (_RECORDER, *_spools(len(self.recorder.parts)))]
        if spools[0] is None:
            return
        self.recorder.attach(spools[0])
        for history, spool in zip(histories, spools[1:], strict=True):
            assert spool is not None
            history.attach_spool(spool, store.thread)

    def advance(self, chunk: Detections, times_s: np.ndarray) -> None:
        """Track people through more frames; ``times_s``: shape (frame,)."""
        for tracked in _track(self.tracker, chunk, times_s):
            self.recorder.add(self.tracker, tracked)
        self.done += chunk.n_frames


class _Store:
    """Saves stages in a checkpoint, in a thread if there is one.

    Args:
        checkpoint: stores the state.
        thread: stores one state, and moves entries to the spools, while the next frames are tracked; or None.
    """

    def __init__(self, checkpoint: Checkpoint, thread: Executor | None = None) -> None:
        self.checkpoint, self.thread = checkpoint, thread
        self._last: Callable[[], None] = _done

    def save(self, stage: _Stage) -> _Stage:
        """Save the state, and return it as a resumed run loads it."""
        # The length of the spools is stored with each state, so they must not grow before it is.
        self._last()
        stage.recorder.spool_entries()
        if self.thread is None:
            saved = self.checkpoint.save(_NAME, stage)
        else:
            saved, self._last = self.checkpoint.begin_save(_NAME, stage, self.thread)
        if saved is not stage:
            saved.attach(self)
        return saved

    def wait(self) -> None:
        """Wait until the last state is stored and the thread has nothing left to do."""
        if self.thread is not None:
            self.thread.submit(_done).result()
        self._last()


def _done() -> None:
    pass


def _track(tracker: ArticulatedTracker, chunk: Detections, times_s: np.ndarray) -> Iterator[TrackedFrame]:
    """Return the people of each frame; ``times_s``, shape (frame,), is used where no view recorded the frame."""
    for i in range(chunk.n_frames):
        frame = Frame.of(chunk, i)
        if not frame.recorded.any():
            frame = replace(frame, time_s=np.full(len(frame.recorded), times_s[i]))
        yield tracker.process(frame)


def _spools(parts: int) -> tuple[str, ...]:
    return (f"{_NAME}.body", *(f"{_NAME}.part_{i}" for i in range(parts)))


def frame_times(detections: Detections) -> np.ndarray:
    """Return frame times, shape (frame,), interpolated where no view recorded the frame; NaN if unknown."""
    known = np.asarray(detections.recorded) & np.isfinite(detections.time_s)
    last = np.where(known, detections.time_s, -np.inf).max(axis=1)
    return fill_missing_times(np.where(np.isfinite(last), last, np.nan), detections.frame_numbers)
