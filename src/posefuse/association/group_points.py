"""Triangulated points of groups of detections, one keypoint at a time."""

from dataclasses import dataclass

import numpy as np

from posefuse.arrays import frozen, kernel_array
from posefuse.kernels import status_codes
from posefuse.kernels.records import NoiseParameters, Observations, TriangulatedPoints
from posefuse.kernels.triangulation.consensus import triangulate_consensus
from posefuse.kernels.triangulation.pair_order import early_limit, ordered_pairs, required_tries
from posefuse.kernels.triangulation.workspace import ConsensusParameters
from posefuse.model.cameras import CameraRig
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions
from posefuse.skeleton.skeletons import Skeleton


@dataclass(frozen=True)
class GroupPoints:
    """Triangulated points of several groups.

    Attributes:
        points_m: shape (person, keypoint, 3), NaN where missing.
        covariance_m2: shape (person, keypoint, 6).
        status: shape (person, keypoint), int8, point codes.
        used: shape (person, keypoint, view), bool.
        error_sigma: shape (person,): median reprojection error of used observations, in standard deviations.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    status: np.ndarray
    used: np.ndarray
    error_sigma: np.ndarray


def triangulate_groups(
    rig: CameraRig,
    frame: Frame,
    noise: NoiseModel,
    skeleton: Skeleton,
    rows: np.ndarray,
    swapped: np.ndarray,
    options: AssociationOptions,
) -> GroupPoints:
    """Triangulate the points of each group on which most views agree.

    Args:
        rig: Cameras.
        frame: The detections.
        noise: Noise model of the detections.
        skeleton: Skeleton of the keypoints.
        rows: shape (person, view), int64: detections of the frame, -1 for none.
        swapped: shape (person, view), bool: detections whose left and right are swapped.
        options: Options of the association, which define how much views may differ.
    """
    n, views = rows.shape
    k = frame.keypoints_px.shape[1]
    pixels, confidence, rows = _unswapped(frame, skeleton, rows, swapped)
    out = TriangulatedPoints.allocate(n, k, views)
    triangulate_consensus(
        rig.packed,
        Observations(kernel_array(pixels), kernel_array(confidence), rows),
        NoiseParameters(frozen(noise.scale_px * options.sigma_factor), noise.exponent, options.min_confidence),
        ConsensusParameters(
            2,
            ordered_pairs(views),
            required_tries(views),
            early_limit(views),
            options.saturation_sigma,
            options.full_weight_sigma,
            options.zero_weight_sigma,
        ),
        out,
    )
    used = (out.view_codes == status_codes.VIEW_USED) & (out.status < status_codes.POINT_MISSING)[..., None]
    error_sigma = median_error_sigma(out.view_errors_px, used, confidence, rows, noise)
    return GroupPoints(out.points, out.covariance, out.status, used, error_sigma)


def median_error_sigma(
    error_px: np.ndarray, used: np.ndarray, confidence: np.ndarray, rows: np.ndarray, noise: NoiseModel
) -> np.ndarray:
    """Return the median reprojection error of each person in standard deviations, shape (person,).

    Args:
        error_px: shape (person, keypoint, view).
        used: shape (person, keypoint, view), bool: observations that count.
        confidence: shape (row, keypoint), NaN where the detector gives none.
        rows: shape (person, view), int64.
        noise: Noise model of the detections.
    """
    trust = np.moveaxis(confidence[rows], 1, 2)
    trust = np.where(np.isnan(trust), 1.0, trust)
    relative = np.where(used, error_px * trust**noise.exponent / noise.scale_px, np.nan)
    return _medians(relative.reshape(len(rows), -1))


def _unswapped(
    frame: Frame, skeleton: Skeleton, rows: np.ndarray, swapped: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the detections with corrected copies of the swapped ones, and the rows that refer to them."""
    pixels, confidence = frame.keypoints_px, frame.confidence
    if not swapped.any():
        return pixels, confidence, rows
    wrong = rows[swapped]
    rows = rows.copy()
    rows[swapped] = len(pixels) + np.arange(len(wrong))
    mirror = skeleton.mirror
    return (
        np.concatenate([pixels, pixels[wrong][:, mirror]]),
        np.concatenate([confidence, confidence[wrong][:, mirror]]),
        rows,
    )


def _medians(values: np.ndarray) -> np.ndarray:
    """Return the median of the finite values of each row; NaN where there are none."""
    ordered = np.sort(values, axis=1)
    count = np.isfinite(ordered).sum(axis=1)
    each = np.arange(len(values))
    low, high = ordered[each, np.maximum(count - 1, 0) // 2], ordered[each, count // 2 - (count == values.shape[1])]
    return np.where(count > 0, 0.5 * (low + np.where(count % 2 == 1, low, high)), np.nan)
