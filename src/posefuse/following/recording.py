"""Many people followed through a recording: association and tracking wired together."""

from dataclasses import replace

import numpy as np

from posefuse.association.subjects import Subjects
from posefuse.following.book import Book
from posefuse.following.followed import Followed
from posefuse.following.noise import rough_noise
from posefuse.following.trackers import tracker_of, with_tree
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections, with_lacking_times
from posefuse.model.frames import Frame
from posefuse.model.options import Options
from posefuse.progress import Progress
from posefuse.tracking.history import History

_NEVER_S = 1e9
_SURE_LOG_ODDS = 1e9
_ANYWHERE = 1e9


def follow_subject(
    rig: CameraRig, detections: Detections, subject: Subjects, options: Options, progress: Progress
) -> Followed:
    """Fit a body to the one subject of a recording: followed like many, from their detections alone.

    Raises:
        DetectionsError: if frames have no times.
        SkeletonError: if the skeleton has no tree, and none can be measured.
    """
    everything = detections.frames(0, detections.n_frames)
    theirs = subject.follow(0, detections.n_frames).rows(everything)[:, 0]
    kept = theirs >= 0
    rows = theirs[kept]
    depth = None if everything.depth is None else np.asarray(everything.depth)[rows]
    alone = replace(
        everything,
        offsets=np.concatenate([[0], np.cumsum(kept.ravel())]),
        keypoints_px=np.asarray(everything.keypoints_px)[rows],
        confidence=np.asarray(everything.confidence)[rows],
        track_ids=np.asarray(everything.track_ids)[rows],
        depth=depth,
    )
    # Whoever comes back is the subject.
    anywhere = replace(options.tracker.specification, reacquire_gate=_ANYWHERE)
    tracker = replace(
        options.tracker, max_people=1, forget_after_s=_NEVER_S, reacquire_log_odds=-_SURE_LOG_ODDS,
        specification=anywhere,
    )  # fmt: skip
    return follow(rig, alone, replace(options, tracker=tracker), progress)


def follow(rig: CameraRig, detections: Detections, options: Options, progress: Progress) -> Followed:
    """Follow everybody through a recording.

    Raises:
        DetectionsError: if frames have no times.
        SkeletonError: if the skeleton has no tree, and none can be measured.
    """
    noise = rough_noise(rig, detections, options)
    tracker = tracker_of(rig, with_tree(rig, detections, noise, options), noise, options)
    book = Book(History(tracker.settings), tuple(History(part.settings) for part in tracker.parts))
    progress.start("following people", detections.n_frames)
    done = 0
    times_s = _times(detections)
    for chunk in detections.chunks():
        for i in range(chunk.n_frames):
            frame = Frame.of(chunk, i)
            if not frame.recorded.any():
                frame = replace(frame, time_s=np.full(len(rig), times_s[done + i]))
            book.enter(tracker, tracker.update(frame))
        done += chunk.n_frames
        progress.advance(chunk.n_frames)
    progress.finish()
    return book.close(detections)


def _times(detections: Detections) -> np.ndarray:
    """Shape (frame,): when frames were; of those that no view recorded, when they should have been; NaN if unknown."""
    known = np.asarray(detections.recorded) & np.isfinite(detections.time_s)
    last = np.where(known, detections.time_s, -np.inf).max(axis=1)
    return with_lacking_times(np.where(np.isfinite(last), last, np.nan), detections.frame_numbers)
