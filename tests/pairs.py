"""Simulated pair solutions: true points with the noise of a solver."""

import numpy as np

from posefuse.kernels import status_codes
from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections

BOUND = 16.0
"""Bound of an observation's cost, in squared standard deviations."""


def covariance_of(rig: CameraRig, points_m: np.ndarray, observed: np.ndarray, sigma_px: float) -> np.ndarray:
    """Return covariances of points seen by the views in ``seen`` (..., view), shape (..., 3, 3)."""
    step = 1e-4
    shifted = np.stack([(rig.project(points_m + step * axis) - rig.project(points_m)) / step for axis in np.eye(3)])
    jacobian = np.moveaxis(np.nan_to_num(shifted), (0, 2), (-1, -3))
    information = np.einsum("...v,...via,...vib->...ab", observed.astype(float), jacobian, jacobian) / sigma_px**2
    return np.linalg.inv(information + 1e-6 * np.eye(3))


def simulate_pairs(
    rig: CameraRig, truth_m: np.ndarray, detections: Detections, sigma_px: float, rng: np.random.Generator
) -> SolvedPairs:
    """Simulate pairs of one person from true keypoints (frame, keypoint, 3), with evidence from the detections.

    The first point of a pair is the one that most labels call left.
    """
    columns = detections.skeleton.pair_indices
    pixels = np.moveaxis(detections.dense()[0][:, :, columns], 1, 3)
    visible = np.isfinite(pixels).all(axis=-1)
    two = visible.any(axis=2, keepdims=True) & np.ones_like(visible)
    covariance = covariance_of(rig, truth_m[:, columns], two, sigma_px)
    points = truth_m[:, columns] + np.einsum(
        "...ab,...b->...a", np.linalg.cholesky(covariance), rng.standard_normal((*visible.shape[:3], 3))
    )
    missing = two.sum(axis=-1) < 2
    points[missing] = np.nan
    entries = covariance[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    expected = np.moveaxis(rig.project(np.nan_to_num(points)), 1, 3)

    def cost(label: int, point: int) -> np.ndarray:
        off = np.square(pixels[:, :, label] - expected[:, :, point]).sum(axis=-1) / sigma_px**2
        return np.where(visible[:, :, label], np.minimum(np.nan_to_num(off), BOUND), 0.0)

    evidence = cost(0, 0) + cost(1, 1) - cost(0, 1) - cost(1, 0)
    evidence[missing.any(axis=-1)] = 0.0
    wrong = np.clip(evidence, -8, 8).sum(axis=-1) > 0
    flip = wrong[:, :, None]
    labels = np.where(evidence[..., None] > 0, [1, 0], [0, 1])
    other = np.moveaxis(two & ~missing[..., None], 2, 3)
    used = np.where(other, labels, -1).astype(np.int8)
    return SolvedPairs(
        points_m=np.where(flip[..., None], points[:, :, ::-1], points),
        covariance_m2=np.where(flip[..., None], entries[:, :, ::-1], entries),
        status=np.where(missing, status_codes.POINT_TOO_FEW_VIEWS, status_codes.POINT_OK).astype(np.int8),
        used=np.where(flip[..., None], used[..., ::-1], used),
        view_error_px=np.full(used.shape, sigma_px, dtype=np.float32),
        view_status=np.where(other, status_codes.VIEW_USED, status_codes.VIEW_UNSEEN).astype(np.int8),
        evidence=np.where(wrong[..., None], -evidence, evidence).astype(np.float32),
        cost=np.zeros(wrong.shape),
    )
