"""Deviations of keypoints from fitted bodies.

Bodies have rigid segments and a motion model, but skin slides, spines bend, detectors place keypoints beside the
joints, and some movements are faster than expected. So a keypoint of the model layer is that of the body plus a
deviation with zero mean and the same standard deviation in all directions, one per keypoint. The measured point of the
frame shows it: its best linear prediction is the residual times ``variance / (variance + covariance of the measured
point)``. Residuals that are large for both have less weight, as under a Student's t distribution, because they are
measurement errors.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Reconstruction, pack_covariance, unpack_covariance
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.pipeline.people.model_layer import model_layer

_NU = 3.0
"""Degrees of freedom of the Student's t distribution of residuals."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Measured points relative to those of bodies, where both exist, in the principal axes of the measurement.

    Attributes:
        exists: shape (..., keypoint), bool: whether both points exist.
        along_m: shape (point, 3): the residuals.
        variance_m2: shape (point, 3): variances of the measured points.
        axes: shape (point, 3, 3): world from principal axes.
    """

    exists: np.ndarray
    along_m: np.ndarray
    variance_m2: np.ndarray
    axes: np.ndarray

    @classmethod
    def of(cls, body_m: np.ndarray, measured_m: np.ndarray, covariance_m2: np.ndarray) -> "Residuals":
        """Return the residuals of points.

        Args:
            body_m: shape (..., keypoint, 3), NaN where missing.
            measured_m: shape (..., keypoint, 3), NaN where missing.
            covariance_m2: shape (..., keypoint, 6): covariance of the measured points.
        """
        exists = np.isfinite(body_m[..., 0]) & np.isfinite(measured_m[..., 0]) & np.isfinite(covariance_m2).all(axis=-1)
        variance, axes = np.linalg.eigh(unpack_covariance(covariance_m2[exists]))
        along = np.einsum("nji,nj->ni", axes, measured_m[exists] - body_m[exists])
        return cls(exists, along, np.maximum(variance, 0.0), axes)

    def gains(self, deviation_m2: np.ndarray) -> np.ndarray:
        """Return the share of each residual that is a deviation, shape (point, 3), for variances of shape (point,)."""
        total = self.variance_m2 + deviation_m2[:, None]
        gains = np.divide(deviation_m2[:, None], total, out=np.zeros_like(total), where=total > 0.0)
        squared = np.divide(self.along_m**2, total, out=np.zeros_like(total), where=total > 0.0).sum(axis=1)
        return gains * np.minimum((_NU + 3.0) / (_NU + squared), 1.0)[:, None]

    def deviations_m(self, gains: np.ndarray) -> np.ndarray:
        """Return the deviations, shape (point, 3), in the world."""
        return np.einsum("nij,nj->ni", self.axes, gains * self.along_m)


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
    points, covariance = np.array(body[0]), np.array(body[1])
    variance = np.broadcast_to(np.square(sd_m), points.shape[:-1])
    residuals = Residuals.of(np.where(variance[..., None] > 0.0, points, np.nan), *measured)
    exists = residuals.exists
    gains = residuals.gains(variance[exists])
    own = unpack_covariance(covariance[exists])
    in_axes = np.einsum("nji,njk,nkl->nil", residuals.axes, own, residuals.axes)
    rest = np.sqrt(1.0 - gains**2)
    in_axes = rest[:, :, None] * in_axes * rest[:, None, :]
    added = (1.0 - gains) ** 2 * variance[exists][:, None] + gains**2 * residuals.variance_m2
    in_axes[:, [0, 1, 2], [0, 1, 2]] += added
    points[exists] += residuals.deviations_m(gains)
    # Where nothing was measured, the deviation is unknown.
    covariance[..., [0, 3, 5]] += np.where(exists, 0.0, variance)[..., None]
    covariance[exists] = pack_covariance(np.einsum("nij,njk,nlk->nil", residuals.axes, in_axes, residuals.axes))
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
    used = np.moveaxis(np.asarray(layer.view_status) == ViewStatus.USED, 3, 2)
    absent = (np.asarray(layer.status) == PointStatus.ABSENT).all(axis=-1)
    rows = part.tracks.rows(detections)
    errors = model_layer(part.rig, detections, rows, points, covariance, used, absent)
    layer = replace(
        layer,
        points_m=points,
        covariance_m2=covariance,
        reprojection_error_px=errors.reprojection_error_px,
        view_error_px=errors.view_error_px,
    )
    return replace(part, layers={**part.layers, "model": layer})
