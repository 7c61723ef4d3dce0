"""Records of arrays and parameters that several kernels take as arguments.

A field always has the same type, so that each kernel is compiled once.
"""

from typing import Any, NamedTuple

import numpy as np


class Detections(NamedTuple):
    """Detections of one frame.

    Attributes:
        keypoints_px: shape (row, keypoint, 2), NaN where missing.
        confidence: shape (row, keypoint), NaN where the detector gives none.
        view: shape (row,), int64: view of each detection.
    """

    keypoints_px: Any
    confidence: Any
    view: Any


class Observations(NamedTuple):
    """Detections of people over frames.

    Attributes:
        keypoints_px: shape (detection, keypoint, 2), NaN where missing.
        confidence: shape (detection, keypoint), NaN where the detector gives none.
        detection_rows: shape (person_frame, view), int64: rows of the two arrays above, NO_DETECTION or NOT_RECORDED.
    """

    keypoints_px: Any
    confidence: Any
    detection_rows: Any


class NoiseParameters(NamedTuple):
    """Noise of detections and their minimum confidence.

    Attributes:
        scale_px: shape (view,): noise of a detection of confidence 1, in px per axis.
        exponent: the noise is ``scale_px / confidence^exponent``.
        min_confidence: keypoints below this confidence are not used.
    """

    scale_px: Any
    exponent: float
    min_confidence: float


class TriangulatedPoints(NamedTuple):
    """Results of triangulation, written by kernels.

    Attributes:
        points: shape (person_frame, keypoint, 3), NaN where missing.
        covariance: shape (person_frame, keypoint, 6): xx xy xz yy yz zz.
        status: shape (person_frame, keypoint), int8: point codes.
        view_codes: shape (person_frame, keypoint, view), int8.
        view_errors_px: shape (person_frame, keypoint, view), float32: reprojection errors of every view that has a
            detection, used or not.
        mean_errors_px: shape (person_frame, keypoint): mean error over the used views.
    """

    points: Any
    covariance: Any
    status: Any
    view_codes: Any
    view_errors_px: Any
    mean_errors_px: Any

    @classmethod
    def allocate(cls, n: int, n_keypoints: int, n_views: int) -> "TriangulatedPoints":
        """Allocate uninitialized arrays for ``n`` people and frames."""
        return cls(
            points=np.empty((n, n_keypoints, 3)),
            covariance=np.empty((n, n_keypoints, 6)),
            status=np.empty((n, n_keypoints), dtype=np.int8),
            view_codes=np.empty((n, n_keypoints, n_views), dtype=np.int8),
            view_errors_px=np.empty((n, n_keypoints, n_views), dtype=np.float32),
            mean_errors_px=np.empty((n, n_keypoints)),
        )
