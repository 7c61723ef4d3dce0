"""One camera's detections at one time, as a live stream receives them."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class ViewMessage:
    """One camera's people at one time.

    Attributes:
        view: index of the camera in the rig.
        time_s: time of the frame by the sender's clock.
        keypoints_px: shape (person, keypoint, 2), NaN where not detected.
        confidence: shape (person, keypoint), NaN where the detector gives none.
        track_ids: shape (person,), int64: the detector's identities, -1 where it gives none.
    """

    view: int
    time_s: float
    keypoints_px: np.ndarray
    confidence: np.ndarray
    track_ids: np.ndarray
