"""What one camera saw at one time, as it comes in live."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class SeenView:
    """One camera's people at one time.

    Attributes:
        view: number of the camera in the rig.
        time_s: when it took the frame, by the sender's clock.
        keypoints_px: shape (person, keypoint, 2), NaN where not detected.
        confidence: shape (person, keypoint), NaN where the detector gives none.
        track_ids: shape (person,), int64: the detector's own identities, -1 where it has none.
    """

    view: int
    time_s: float
    keypoints_px: np.ndarray
    confidence: np.ndarray
    track_ids: np.ndarray
