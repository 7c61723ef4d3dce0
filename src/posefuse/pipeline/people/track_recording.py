"""Track people through a recording."""

import itertools
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from posefuse.arrays import ranges
from posefuse.checkpoint import NO_CHECKPOINT, Checkpoint
from posefuse.errors import PosefuseWarning
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import CHUNK_FRAMES, Detections
from posefuse.model.options.options import Options
from posefuse.model.subjects import Subjects
from posefuse.model.tracks import Tracks
from posefuse.parallel import ONE_JOB, Jobs
from posefuse.pipeline.people.initial_noise import initial_noise, sample_frames
from posefuse.pipeline.people.part_recorder import PartFollower, PartRecorder, frames_of, load_parts, part_spools
from posefuse.pipeline.people.recorder import Recorder
from posefuse.pipeline.people.tracked_people import TrackedPeople
from posefuse.pipeline.people.trackers import tracker_of, with_tree
from posefuse.preprocess.timeline import fill_missing_times
from posefuse.progress import Progress
from posefuse.tracking.history import History
from posefuse.tracking.tracker import ArticulatedTracker

_NEVER_S = 1e9
_CERTAIN_LOG_ODDS = 1e9
_UNLIMITED_GATE = 1e9
_NAME = "tracking"
_RECORDER, _BODY = f"{_NAME}.recorder", f"{_NAME}.body"
_PIECE_FRAMES = 512
"""Number of frames after which another process continues with hands and faces."""
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
    jobs: Jobs = ONE_JOB,
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
        jobs: as of :func:`track_people`.

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
    found = track_people(rig, alone, options, progress, checkpoint, made, jobs)
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
        jobs: with several, a thread reads ahead, another one stores, and processes track hands and faces.
        stored: indices of frames, in ascending order; the checkpoint stores the tracker as it is before each of them,
            under the name that :func:`tracker_name` returns. People are tracked again from the start if one of them is
            missing.

    Raises:
        DetectionsError: if frames have no times.
        SkeletonError: if the skeleton has no kinematic tree, and none can be measured.
    """
    times_s = frame_times(detections)
    begun = _load(checkpoint)
    reached = 0 if begun is None else max(each.done for each in (begun[0], *begun[1]))
    if begun is None or any(checkpoint.load(tracker_name(place)) is None for place in stored if place <= reached):
        begun = _begin(tracker or first_tracker(rig, detections, options), checkpoint)
        if 0 in stored:
            _store_tracker(checkpoint, *begun)
    stage, parts = begun
    progress.start("tracking people", detections.n_frames)
    progress.advance(stage.done)
    spans = [span for span in ranges(detections.n_frames, options.chunk_frames) if span[0] >= stage.done]
    with jobs.thread() as thread:
        store = _Store(checkpoint, thread)
        stage.attach(store)
        # A stored tracker includes those of hands and faces before the same frame.
        follower = PartFollower(parts, checkpoint, ONE_JOB if stored else jobs)
        try:
            chunks = jobs.ahead(detections.frames(*span) for span in spans)
            for chunk, (start, stop) in zip(chunks, spans, strict=True):
                bounds = [start, *(place for place in stored if start < place <= stop), stop]
                for first, last in itertools.pairwise(bounds):
                    stage.advance(chunk.frames(first - start, last - start), times_s[first:last], follower)
                    if last in stored:
                        _store_tracker(checkpoint, stage, follower.wait())
                stage = store.save(stage, follower)
                progress.advance(stop - start)
            store.wait()
            parts = follower.wait()
        except KeyboardInterrupt:
            # A second interruption while the thread still works ends the run, and the next run resumes.
            store.wait()
            follower.wait()
            saved = _load(checkpoint)
            if saved is None or not checkpoint.enabled or _are_ahead(saved[1], saved[0]):
                raise
            stage, parts = saved
    progress.finish()
    offsets = detections.offsets[: stage.done * detections.n_views + 1]
    return stage.recorder.close(parts, offsets, detections.n_views)


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
    stage, parts = _begin(tracker, NO_CHECKPOINT)
    follower = PartFollower(parts, NO_CHECKPOINT, ONE_JOB)
    for start, stop in ranges(detections.n_frames, CHUNK_FRAMES):
        stage.advance(detections.frames(start, stop), times_s[start:stop], follower)
    return stage.recorder.close(parts, detections.offsets, detections.n_views)


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
    """The state of tracking bodies between two chunks.

    Attributes:
        tracker: tracker after the last frame, without those of hands and faces.
        recorder: record of all frames.
        done: number of frames processed.
    """

    tracker: ArticulatedTracker
    recorder: Recorder
    done: int = 0

    def attach(self, store: "_Store") -> None:
        """Let the recorder and its history append to the spools of a checkpoint, if it has any."""
        entries, states = (store.checkpoint.spool(name) for name in (_RECORDER, _BODY))
        if entries is not None and states is not None:
            self.recorder.attach(entries)
            self.recorder.history.attach_spool(states, store.thread)

    def advance(self, chunk: Detections, times_s: np.ndarray, follower: PartFollower) -> None:
        """Track people through more frames.

        Args:
            chunk: detections of the frames.
            times_s: shape (frame,): their times.
            follower: tracks hands and faces.
        """
        for first, last in ranges(chunk.n_frames, _PIECE_FRAMES):
            piece, bodies = (chunk.frames(first, last), times_s[first:last]), []
            for frame in frames_of(*piece):
                tracked = self.tracker.track_bodies(frame)
                self.recorder.add(self.tracker, tracked)
                if tracked.bodies is not None:
                    bodies.append(tracked.bodies)
            if bodies:
                follower.follow(self.done, (*piece, bodies))
            self.done += last - first


def _begin(tracker: ArticulatedTracker, checkpoint: Checkpoint) -> tuple[_Stage, list[PartRecorder]]:
    """Return the state before the first frame."""
    spools = part_spools(checkpoint, len(tracker.parts))
    parts = [PartRecorder(part, spool) for part, spool in zip(tracker.parts, spools, strict=True)]
    tracker.parts = ()
    history = History(tracker.settings, checkpoint.spool(_BODY))
    return _Stage(tracker, Recorder(history, checkpoint.spool(_RECORDER))), parts


def _load(checkpoint: Checkpoint) -> tuple[_Stage, list[PartRecorder]] | None:
    """Return the last state that was saved, or None."""
    stage = checkpoint.load(_NAME)
    parts = None if stage is None else load_parts(checkpoint, len(stage.tracker.settings.skeleton.parts))
    # Hands and faces are stored first, so they may be ahead of the bodies.
    if stage is None or parts is None or any(part.done < stage.done for part in parts):
        return None
    stage.attach(_Store(checkpoint))
    return stage, parts


def _are_ahead(parts: Sequence[PartRecorder], stage: _Stage) -> bool:
    """Return whether the records of hands and faces include later frames than that of the bodies."""
    return any(part.done > stage.done for part in parts)


def _store_tracker(checkpoint: Checkpoint, stage: _Stage, parts: Sequence[PartRecorder]) -> None:
    """Store the tracker with those of hands and faces as they are before the next frame.

    If these are ahead of the bodies, an earlier run has stored the tracker.
    """
    if not _are_ahead(parts, stage):
        whole = copy(stage.tracker)
        whole.parts = tuple(part.tracker for part in parts)
        checkpoint.save(tracker_name(stage.done), whole)


class _Store:
    """Saves stages in a checkpoint, in a thread if there is one.

    Args:
        checkpoint: stores the state.
        thread: stores one state, and moves entries to the spools, while the next frames are tracked; or None.
    """

    def __init__(self, checkpoint: Checkpoint, thread: Executor | None = None) -> None:
        self.checkpoint, self.thread = checkpoint, thread
        self._last: Callable[[], None] = _done

    def save(self, stage: _Stage, follower: PartFollower) -> _Stage:
        """Save the state, and that of hands and faces before it; return it as a resumed run loads it."""
        # The length of the spools is stored with each state, so they must not grow before it is.
        self._last()
        stage.recorder.spool_entries()
        if self.thread is None:
            follower.save()
            saved = self.checkpoint.save(_NAME, stage)
        else:
            saved, self._last = self.checkpoint.begin_save(_NAME, stage, follower.begin_save(self.thread))
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


def frame_times(detections: Detections) -> np.ndarray:
    """Return frame times, shape (frame,), interpolated where no view recorded the frame; NaN if unknown."""
    known = np.asarray(detections.recorded) & np.isfinite(detections.time_s)
    last = np.where(known, detections.time_s, -np.inf).max(axis=1)
    return fill_missing_times(np.where(np.isfinite(last), last, np.nan), detections.frame_numbers)
