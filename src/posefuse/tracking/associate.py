"""Second step of the tracker: assign the detections of all views to tracks."""

from dataclasses import dataclass

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.tracking.frame_statistics import assign_labels, clear_majority_swaps, record_matches
from posefuse.kernels.tracking.matching import match_views
from posefuse.model.frames import Frame
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.tracking.fast_motion import assign_fast_motion
from posefuse.tracking.partial_detections import merge_partial_detections
from posefuse.tracking.predict import FrameInput, Prediction
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.shared_detections import share_between_tracks
from posefuse.tracking.strategy import TrackerSetup
from posefuse.tracking.track_set import TrackSet


@dataclass(frozen=True, eq=False)
class Association:
    """Assignment of a frame's detections to tracks.

    Attributes:
        frame: The detections; assigned ones hold the keypoints of partial detections merged into them.
        rows: shape (track, view), int64: assigned detections, -1 for none.
        labels: shape (track, view, keypoint), int64: which of a detection's keypoints is the body's, -1 for none.
        explained: shape (row,), bool: detections of tracked people, whether assigned or not.
        shared: shape (track, view), int64: detections that update the tracks: the assigned ones, and those of others
            with keypoints of this track.
    """

    frame: Frame
    rows: np.ndarray
    labels: np.ndarray
    explained: np.ndarray
    shared: np.ndarray


def associate(
    tracks: TrackSet, frame: FrameInput, prediction: Prediction, rejected: np.ndarray, setup: TrackerSetup
) -> Association:
    """Assign detections to tracks, at most one per view and track.

    Args:
        tracks: Updated in place: recent histories, and the states of people who moved fast.
        frame: The frame.
        prediction: Predicted tracks; in and out as the states are.
        rejected: shape (view,), bool: cameras whose unassigned detections are not used.
        setup: Setup of the tracker.
    """
    s, options = setup.settings, setup.settings.options
    views, keypoints, detections = len(s.rig), len(s.skeleton), frame.frame
    if not len(tracks):
        nothing = np.empty((0, views), dtype=np.int64)
        labels = np.empty((0, views, keypoints), dtype=np.int64)
        return Association(detections, nothing, labels, np.zeros(len(detections.view), dtype=bool), nothing)
    scores = setup.strategy.score.match(prediction.projected, detections, tracks.recent, setup.strategy.noise, s)
    rows = np.empty((len(tracks), views), dtype=np.int64)
    match_views(scores.gain, detections.view, views, scores.min_gain, rows)
    if options.fast_motion.enabled:
        unassigned = find_unassigned(detections, rows, scores.explained, rejected)
        assign_fast_motion(tracks, frame, prediction, rows, scores, unassigned, setup)
    suppress_single_view_matches(rows, scores.gain, tracks.is_in_state(TrackState.LOST), options)
    clear_majority_swaps(rows, scores.swapped)
    if options.partial_detections.enabled:
        detections = merge_partial_detections(detections, rows, scores, s)
    labels = _keypoint_labels(rows, scores.swapped, s)
    record_matches(
        rows, scores.swapped, scores.swap_odds, frozen(detections.track_ids, np.int64), frame.dt_s,
        tracks.recent.single_view_s, tracks.recent.swapped, tracks.recent.detector_ids,
    )  # fmt: skip
    shared = rows
    if options.shared_detections.enabled and len(tracks) > 1:
        active = tracks.is_in_state(TrackState.ACTIVE)
        shared = share_between_tracks(detections, rows, labels, prediction.projected, active, s)
    return Association(detections, rows, labels, scores.explained, shared)


def find_unassigned(
    frame: Frame, rows: np.ndarray, explained: np.ndarray, rejected: np.ndarray | None = None
) -> np.ndarray:
    """Return the detections that show no tracked person, shape (row,), bool.

    Args:
        frame: The detections.
        rows: shape (track, view), int64: assigned detections, -1 for none.
        explained: shape (row,), bool: detections of tracked people, whether assigned or not.
        rejected: shape (view,), bool: cameras that are left out; None leaves out none.
    """
    unassigned = ~explained
    unassigned[rows[rows >= 0]] = False
    return unassigned if rejected is None else unassigned & ~rejected[frame.view]


def suppress_single_view_matches(rows: np.ndarray, gain: np.ndarray, lost: np.ndarray, options: TrackerOptions) -> None:
    """Drop matches of a single view that are too weak to move a track.

    A single view does not move a lost track. Nor does it move an active track by a detection that fits another track
    better, which has its own detection in that view: it is a second detection of that person.

    Args:
        rows: shape (track, view), updated in place.
        gain: shape (track, row): gain of each match.
        lost: shape (track,), bool: which tracks are lost.
        options: Options of the tracker.
    """
    n_views, is_lost = (rows >= 0).sum(axis=1).tolist(), lost.tolist()
    for p, shown in enumerate(n_views):
        if is_lost[p] and shown < options.reacquire_views:
            rows[p] = -1
    for p in [p for p, shown in enumerate(n_views) if shown == 1 and not is_lost[p]]:
        v = int(rows[p].argmax())
        others = gain[rows[:, v] >= 0, rows[p, v]]
        if others.max() > gain[p, rows[p, v]]:
            rows[p] = -1


def _keypoint_labels(rows: np.ndarray, swapped: np.ndarray, settings: TrackerSettings) -> np.ndarray:
    """Return which of a detection's keypoints is the body's, shape (track, view, keypoint)."""
    labels = np.empty((*rows.shape, len(settings.skeleton)), dtype=np.int64)
    assign_labels(rows, swapped, settings.frozen_groups, settings.skeleton.mirror, labels)
    return labels
