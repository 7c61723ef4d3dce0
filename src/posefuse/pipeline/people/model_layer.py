"""Convert the points of fitted bodies to the model layer."""

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, Source, ViewStatus, status_of_views


def model_layer(
    rig: CameraRig,
    detections: Detections,
    rows: np.ndarray,
    points_m: np.ndarray,
    covariance_m2: np.ndarray,
    used: np.ndarray,
    absent: np.ndarray,
) -> Layer:
    """Return the points of fitted bodies as a layer, with reprojection errors.

    The status states how many views of the frame support the keypoint; without any, it is filled.

    Args:
        rig: calibrated cameras.
        detections: detections of the frames.
        rows: shape (frame, person, view): rows of the detections' arrays.
        points_m: shape (frame, person, keypoint, 3), NaN where there is none.
        covariance_m2: shape (frame, person, keypoint, 6).
        used: shape (frame, person, view, keypoint), bool.
        absent: shape (frame, person), bool: people who are not present.
    """
    errors = view_errors(rig, detections, rows, points_m)
    counted = np.moveaxis(used, 2, 3) & np.isfinite(errors)
    present = np.isfinite(points_m[..., 0])
    # The missing keypoints of a body belong to a part that is not tracked, or to no tracked part.
    missing = np.where(present.any(axis=-1, keepdims=True), PointStatus.NOT_FOLLOWED, PointStatus.NOT_SEEN)
    number = counted.sum(axis=-1)
    status = np.where(present, status_of_views(number), missing)
    status[absent] = PointStatus.ABSENT
    views = np.where(counted, ViewStatus.USED, np.where(np.isnan(errors), ViewStatus.UNSEEN, ViewStatus.OUTLIER))
    has = status < PointStatus.NOT_SEEN
    source = np.where(status == PointStatus.FILLED, Source.FILLED, Source.MODELED)
    return Layer(
        points_m=points_m,
        covariance_m2=covariance_m2,
        status=status.astype(np.int8),
        source=np.where(has, source, Source.NONE).astype(np.int8),
        reprojection_error_px=mean_errors(errors, counted),
        view_status=views.astype(np.int8),
        view_error_px=errors,
    )


def view_errors(rig: CameraRig, detections: Detections, rows: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Return reprojection errors of points in all views.

    Args:
        rig: calibrated cameras.
        detections: detections of the frames.
        rows: shape (frame, person, view): rows of the detections' arrays, -1 for none.
        points_m: shape (frame, person, keypoint, 3), NaN where there is none.

    Returns:
        Errors in pixels, shape (frame, person, keypoint, view), float32, NaN without point or detection.
    """
    errors = np.full((*points_m.shape[:3], len(rig)), np.nan, dtype=np.float32)
    keypoints_px = np.asarray(detections.keypoints_px)
    for v, camera in enumerate(rig.cameras):
        present = rows[:, :, v] >= 0
        apart = camera.project(points_m[present])[0] - keypoints_px[rows[:, :, v][present]]
        errors[present, :, v] = np.sqrt(apart[..., 0] ** 2 + apart[..., 1] ** 2)
    return errors


def mean_errors(errors_px: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """Return the means of the counted errors over views, the last axis; NaN where none is counted."""
    number = counted.sum(axis=-1)
    mean = np.where(counted, errors_px, 0.0).sum(axis=-1) / np.maximum(number, 1)
    return np.where(number > 0, mean, np.nan)
