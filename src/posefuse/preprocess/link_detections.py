"""Link the detections of a view over time into short tracks, before anything is known about the cameras.

A link must be unambiguous: a track ends where another detection or another track is nearly as close, so that people who
cross each other give several short tracks rather than one that changes its person.
"""

import numpy as np

from posefuse.arrays import kernel_array
from posefuse.kernels.calibration.tracklets import ViewRows, link_detections, remove_duplicates
from posefuse.skeleton.skeletons import Skeleton

_LINK_LIMITS = (0.4, 0.06, 2.0, 0.35, 2.5, 0.5)
"""Longest gap in s; gate, its growth per s, its largest value in extents of a person; least ratio of the distances of
the second and the first candidate, and their least difference as a share of the gate."""
_NEAR_NEW = 0.25
_CONSISTENT_IDS = 0.9
_DUPLICATE = 0.06


def link_rows(
    starts: np.ndarray, time_s: np.ndarray, keypoints_px: np.ndarray, ids: np.ndarray, skeleton: Skeleton
) -> np.ndarray:
    """Return the track of each detection of a view, shape (row,), negative for repeated detections.

    Args:
        starts: shape (frame + 1,): first row of each frame.
        time_s: shape (frame,), ascending.
        keypoints_px: shape (row, keypoint, 2), NaN where not detected.
        ids: shape (row,): the detector's identities, -1 without one.
        skeleton: of the keypoint axis.
    """
    without = np.full(len(ids), -1, dtype=np.int64)
    track = _link(starts, time_s, keypoints_px, without, skeleton)
    if (ids >= 0).any() and _same_ids(track, ids) > _CONSISTENT_IDS:
        return _link(starts, time_s, keypoints_px, ids, skeleton)
    return track


def _link(
    starts: np.ndarray, time_s: np.ndarray, keypoints_px: np.ndarray, ids: np.ndarray, skeleton: Skeleton
) -> np.ndarray:
    least_common = min(3, len(skeleton))
    track = np.full(len(ids), -1, dtype=np.int64)
    keypoints_px, ids = kernel_array(keypoints_px), kernel_array(ids, np.int64)
    remove_duplicates(starts, keypoints_px, skeleton.mirror, least_common, _DUPLICATE, track)
    limits = np.array([*_LINK_LIMITS, float(least_common), _NEAR_NEW])
    link_detections(starts, time_s, ViewRows(keypoints_px, ids, skeleton.mirror, limits), track)
    return track


def _same_ids(track: np.ndarray, ids: np.ndarray) -> float:
    """Return the share of links between detections with identities that do not change them."""
    order = np.argsort(track, kind="stable")
    order = order[(track[order] >= 0) & (ids[order] >= 0)]
    linked = track[order][1:] == track[order][:-1]
    same = ids[order][1:] == ids[order][:-1]
    return float(same[linked].mean()) if linked.any() else 0.0
