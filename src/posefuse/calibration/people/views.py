"""What each camera observed of people, before and after the views are matched."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posefuse.model.cameras import Camera
from posefuse.skeleton.skeletons import Skeleton


@dataclass(frozen=True, eq=False)
class ViewTracks:
    """Hold the keypoints of one view by person, at the view's own times.

    Attributes:
        camera: lens and image size; its pose is not used. A camera of unknown focal length holds a guess.
        focal_known: whether the focal length is known.
        time_s: shape (frame,): ascending timestamps of the view's own frames.
        keypoints_px: shape (frame, person, keypoint, 2), NaN where not detected.
        confidence: shape (frame, person, keypoint): the detector's score, 1 without one, NaN where not detected.
    """

    camera: Camera
    focal_known: bool
    time_s: np.ndarray
    keypoints_px: np.ndarray
    confidence: np.ndarray


@dataclass(frozen=True, eq=False)
class PeopleViews:
    """Hold the observations of all views before they are matched: people of different views have no relation yet.

    Attributes:
        skeleton: of the keypoint axis.
        views: one per camera; their person axes differ: each holds the tracks of that view.
        tracked: whether a person index is the same person in all frames of a view. False for pictures that are too far
            apart to be linked: then it only numbers the detections of a frame.
        notes: what was assumed or left out.
        max_offset_s: bound of the time offsets between views.
    """

    skeleton: Skeleton
    views: tuple[ViewTracks, ...]
    tracked: bool = True
    notes: tuple[str, ...] = ()
    max_offset_s: float = 2.0


@dataclass(frozen=True, eq=False)
class MatchedViews:
    """Hold the observations of the views that could be related, and an approximate calibration.

    The person axes of all views agree, and left and right sides are corrected.

    Attributes:
        skeleton: of the keypoint axis.
        views: one per related camera, in the order of :class:`PeopleViews`; ``camera`` holds the approximate pose (and
            focal length if it is not known) in a world of arbitrary orientation, whose scale makes people about as
            large as the skeleton states, or 1.7 m.
        offset_s: shape (view,): true time of the timestamp 0, relative to the first view: true time is ``offset_s +
            rate * time_s``.
        rate: shape (view,): true seconds per second of the timestamps; 1 unless a frame rate is wrong.
        left_out: name and reason of each camera that could not be related.
        notes: what was corrected, such as the share of frames with exchanged sides of each view.
    """

    skeleton: Skeleton
    views: tuple[ViewTracks, ...]
    offset_s: np.ndarray
    rate: np.ndarray
    left_out: Mapping[str, str]
    notes: tuple[str, ...] = ()
