"""Evidence for swapped labels in each view from leave-one-out residuals with heavy-tailed errors."""

import numpy as np

from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import unpack_covariance
from posefuse.model.tracks import Tracks
from posefuse.triangulation.linearized import inverse_2x2, linear_rows

_STUDENT_T_DOF = 3.0
"""Degrees of freedom of the Student-t distribution; 2.7 and more were measured for detectors."""
_MAX_SHARE = 0.99
"""Bound on a view's share in a point: at 1 the view alone determines it and carries no information."""


def robust_evidence(
    rig: CameraRig,
    detections: Detections,
    tracks: Tracks,
    noise: NoiseModel,
    pairs: np.ndarray,
    solved: SolvedPairs,
    min_confidence: float = 0.0,
) -> np.ndarray:
    """Return the evidence for swapped labels in each view, given the points that the other views determine.

    The kernel's own evidence compares each view with points that the view itself helped to place, and assumes Gaussian
    errors. Here residuals are leave-one-out residuals, and errors follow a Student-t distribution.

    Args:
        rig: the cameras.
        detections: in memory.
        tracks: assignment of detections to people.
        noise: error model of the detections.
        pairs: shape (pair, 2): keypoint indices, left and right.
        solved: both points of each pair.
        min_confidence: detections with a lower confidence are ignored.

    Returns:
        Shape (person_frame, pair, view): twice the log-likelihood ratio of swapped to as labeled, 0 where a view has no
        information.
    """
    rows = tracks.rows(detections).reshape(-1, len(rig))
    detected = rows >= 0
    if not detected.any():
        return np.zeros_like(solved.evidence)
    safe = np.where(detected, rows, 0)
    pixels = np.asarray(detections.keypoints_px)[safe][:, :, pairs]
    pixels = np.where(detected[:, :, None, None, None], pixels, np.nan)
    confidence = np.asarray(detections.confidence)[safe][:, :, pairs]
    confidence = np.where(np.isnan(confidence), 1.0, confidence)
    valid = (confidence >= min_confidence) & (confidence > 0.0)
    pixels = np.where(valid[..., None], pixels, np.nan)
    scale = np.where(valid, confidence, 1.0) ** -noise.exponent * noise.scale_px[:, None, None]
    total = np.zeros((2, len(rows), len(pairs), len(rig)))
    # Compare each point with the observations of its own label and of the other label.
    for point in range(2):
        points = solved.points_m[:, :, point].reshape(-1, 3)
        covariance = unpack_covariance(solved.covariance_m2[:, :, point]).reshape(-1, 1, 3, 3)
        seen, shares = [], None
        for label in (point, 1 - point):
            observed = np.moveaxis(pixels[:, :, :, label], 1, 2).reshape(len(points), len(rig), 2)
            residuals, jacobians = linear_rows(rig, points, observed)
            seen.append((residuals, np.moveaxis(scale[..., label], 1, 2).reshape(len(points), len(rig))))
            projected_covariance = jacobians @ covariance @ np.swapaxes(jacobians, -1, -2)
            shares = (
                projected_covariance if shares is None else np.where(np.isnan(shares), projected_covariance, shares)
            )
        used = solved.used[..., point].reshape(len(points), len(rig))
        total += _both_labelings(seen, np.asarray(shares), used, point).reshape(2, *total.shape[1:])
    return (total[1] - total[0]).astype(np.float32)


def _both_labelings(
    seen: list[tuple[np.ndarray, np.ndarray]], spread: np.ndarray, used: np.ndarray, point: int
) -> np.ndarray:
    """Return twice the log-likelihoods of a point's own label and of the other one's, shape (2, point, view).

    Args:
        seen: residuals (point, view, 2) and standard deviations (point, view) of its own label and of the other's.
        spread: shape (point, view, 2, 2): covariance of the projected point.
        used: shape (point, view): label of the observation that the point rests on.
        point: 0 or 1, its own label.
    """
    out = np.zeros((2, *used.shape))
    rests_on = np.where(used == point, 0, np.where(used >= 0, 1, -1))
    shift = np.zeros_like(seen[0][0])
    variance = np.broadcast_to(np.eye(2), spread.shape) * (seen[0][1] ** 2)[..., None, None]
    for which, (residuals, sigma) in enumerate(seen):
        is_own = rests_on == which
        share = spread / (sigma**2)[..., None, None]
        half = 0.5 * (share[..., 0, 0] + share[..., 1, 1])
        half_difference = np.hypot(0.5 * (share[..., 0, 0] - share[..., 1, 1]), share[..., 0, 1])
        share = share * np.minimum(1.0, _MAX_SHARE / np.maximum(half + half_difference, 1e-12))[..., None, None]
        gain = inverse_2x2(np.eye(2) - share)
        moved = ((gain - np.eye(2)) @ residuals[..., None])[..., 0]
        shift = np.where(is_own[..., None], moved, shift)
        variance = np.where(is_own[..., None, None], gain * (sigma**2)[..., None, None], variance)
    variance = np.where((rests_on < 0)[..., None, None], variance + spread, variance)
    inverse = inverse_2x2(variance)
    for which, (residuals, _) in enumerate(seen):
        residual = residuals + shift
        squared = np.einsum("...i,...ij,...j->...", residual, inverse, residual)
        cost = -(_STUDENT_T_DOF + 2.0) * np.log1p(squared / _STUDENT_T_DOF)
        # A missing observation contributes equally to both.
        out[which] = np.where(np.isfinite(cost), cost, 0.0)
    return out
