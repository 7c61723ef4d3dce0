"""Evidence for swapped labels in each view from leave-one-out residuals with heavy-tailed errors."""

import numpy as np

from posefuse.arrays import kernel_array
from posefuse.kernels.left_right.evidence import LabeledRows, add_label_likelihoods
from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.tracks import Tracks
from posefuse.triangulation.linearized import linear_rows

_STUDENT_T_DOF = 3.0
"""Degrees of freedom of the Student-t distribution; 2.7 and more were measured for detectors."""


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
        labels = (point, 1 - point)
        seen = tuple(_rows(rig, points, pixels[:, :, :, label], scale[..., label]) for label in labels)
        used = solved.used[..., point].reshape(len(points), len(rig))
        rests_on = np.where(used == point, 0, np.where(used >= 0, 1, -1))
        covariance = kernel_array(solved.covariance_m2[:, :, point].reshape(-1, 6))
        add_label_likelihoods(seen, rests_on, covariance, _STUDENT_T_DOF, total.reshape(2, *rests_on.shape))
    return (total[1] - total[0]).astype(np.float32)


def _rows(rig: CameraRig, points_m: np.ndarray, pixels: np.ndarray, scale_px: np.ndarray) -> LabeledRows:
    """Return the observations of a label, linearized at the points.

    Args:
        rig: the cameras.
        points_m: shape (person_frame * pair, 3).
        pixels: shape (person_frame, view, pair, 2).
        scale_px: shape (person_frame, view, pair): standard deviations.
    """
    observed = np.moveaxis(pixels, 1, 2).reshape(len(points_m), len(rig), 2)
    sigma = kernel_array(np.moveaxis(scale_px, 1, 2).reshape(len(points_m), len(rig)))
    return LabeledRows(*linear_rows(rig, points_m, observed), sigma)
