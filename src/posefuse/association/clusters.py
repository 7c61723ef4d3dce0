"""Covariance-normalized distances between people, and clusters of people that are the same person."""

import numpy as np
from scipy.sparse.csgraph import connected_components

from posefuse.association.trunk import full


def distance_squared(
    points_a_m: np.ndarray,
    covariance_a_m2: np.ndarray,
    points_b_m: np.ndarray,
    covariance_b_m2: np.ndarray,
    *,
    floor_m: float = 0.0,
    min_common: int = 1,
) -> np.ndarray:
    """Return squared covariance-normalized distances between people: the mean over their common keypoints.

    For two independent estimates of one person its expected value is 3, whatever the number of common keypoints.

    Args:
        points_a_m: shape (a, keypoint, 3), NaN where missing.
        covariance_a_m2: shape (a, keypoint, 6): xx xy xz yy yz zz.
        points_b_m: shape (b, keypoint, 3).
        covariance_b_m2: shape (b, keypoint, 6).
        floor_m: Standard deviation per axis that is added to every difference, because a detector places a keypoint
            differently from different sides.
        min_common: Number of common keypoints below which there is no distance.

    Returns:
        shape (a, b), NaN where there is no distance.
    """
    difference = np.asarray(points_a_m)[:, None] - np.asarray(points_b_m)[None]
    common = np.asarray(np.isfinite(difference).all(axis=-1))
    difference = np.where(common[..., None], difference, 0.0)
    spread = full(covariance_a_m2)[:, None] + full(covariance_b_m2)[None] + floor_m**2 * np.eye(3)
    spread = np.where(common[..., None, None], spread, np.eye(3))
    each = np.einsum("abki,abki->abk", difference, np.linalg.solve(spread, difference[..., None])[..., 0])
    count = common.sum(axis=-1)
    return np.where(count >= max(min_common, 1), each.sum(axis=-1) / np.maximum(count, 1), np.nan)


def cluster(
    points_m: np.ndarray,
    covariance_m2: np.ndarray,
    gate_squared: float,
    *,
    floor_m: float = 0.0,
    min_common: int = 1,
) -> np.ndarray:
    """Cluster people by single linkage.

    Args:
        points_m: shape (person, keypoint, 3), NaN where missing.
        covariance_m2: shape (person, keypoint, 6).
        gate_squared: Largest squared distance, by :func:`distance_squared`, of two people that are linked.
        floor_m: As for :func:`distance_squared`.
        min_common: As for :func:`distance_squared`.

    Returns:
        Index of each person's cluster, shape (person,), int64, counted from 0 in order of first appearance.
    """
    if not len(points_m):
        return np.empty(0, dtype=np.int64)
    apart = distance_squared(points_m, covariance_m2, points_m, covariance_m2, floor_m=floor_m, min_common=min_common)
    labels = connected_components(np.nan_to_num(apart, nan=np.inf) <= gate_squared, directed=False)[1]
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse].astype(np.int64)
