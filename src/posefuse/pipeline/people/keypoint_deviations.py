"""Deviations of keypoints from fitted bodies.

Bodies have rigid segments and a motion model, but skin slides, spines bend, detectors place keypoints beside the
joints, and some movements are faster than expected. So a keypoint of the model layer is that of the body plus a
deviation with zero mean and the same standard deviation in all directions, one per keypoint. The measured point of the
frame shows it: its best linear prediction is the residual times ``variance / (variance + covariance of the measured
point)``. Residuals that are large for both have less weight, as under a Student's t distribution, because they are
measurement errors.
"""

from dataclasses import replace

import numpy as np

from posefuse.arrays import kernel_array
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import ViewStatus
from posefuse.pipeline.people.model_layer import mean_errors, view_errors


def deviating_points(
    body: tuple[np.ndarray, np.ndarray], measured: tuple[np.ndarray, np.ndarray], sd_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return points of bodies with deviations, and their covariances.

    The body was fitted to the detections that give the measured points, so errors common to both do not average out.
    With the gain G, the covariances P of the body's point and C of the measured one, and the variance V of the
    deviation, the covariance is ``sqrt(I - G^2) P sqrt(I - G^2) + (I - G)^2 V + G^2 C``: that of the body without gain
    and deviation, and that of the measured point with a gain of 1.

    Args:
        body: points, shape (frame, person, keypoint, 3), and covariances, shape (frame, person, keypoint, 6).
        measured: the measured points and their covariances, of the same shapes.
        sd_m: shape (keypoint,): standard deviations of the deviations, 0 for a rigid keypoint.

    Returns:
        Points and covariances of the same shapes. Those of rigid keypoints are unchanged.
    """
    from posefuse.kernels.tracking.keypoint_deviations import deviate  # loads the compiler: import on first use

    points, covariance = np.array(body[0], dtype=np.float64), np.array(body[1], dtype=np.float64)
    variance = np.ascontiguousarray(np.broadcast_to(np.square(sd_m), points.shape[:-1]), dtype=np.float64)
    deviate(
        points.reshape(-1, 3),
        covariance.reshape(-1, 6),
        kernel_array(measured[0]).reshape(-1, 3),
        kernel_array(measured[1]).reshape(-1, 6),
        variance.ravel(),
    )
    return points, covariance


def with_deviations(part: Reconstruction, detections: Detections, sd_m: np.ndarray | None) -> Reconstruction:
    """Return a range of frames in which the keypoints of the model layer deviate from the bodies.

    Args:
        part: measured range, in memory, with or without bodies.
        detections: detections of its frames.
        sd_m: shape (keypoint,): standard deviations of the deviations; None if all keypoints are rigid.
    """
    if sd_m is None or not sd_m.any() or "model" not in part.layers or part.tracks is None:
        return part
    layer, measured = part.layers["model"], part.layers["measured"]
    points, covariance = deviating_points(
        (np.asarray(layer.points_m), np.asarray(layer.covariance_m2)),
        (np.asarray(measured.points_m), np.asarray(measured.covariance_m2)),
        sd_m,
    )
    errors = view_errors(part.rig, detections, part.tracks.rows(detections), points)
    counted = (np.asarray(layer.view_status) == ViewStatus.USED) & np.isfinite(errors)
    layer = replace(
        layer,
        points_m=points,
        covariance_m2=covariance,
        reprojection_error_px=mean_errors(errors, counted),
        view_error_px=errors,
    )
    return replace(part, layers={**part.layers, "model": layer})
