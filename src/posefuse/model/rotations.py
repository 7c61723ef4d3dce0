"""Rotations that fit matrices and points."""

import numpy as np


def closest_rotation(matrices: np.ndarray) -> np.ndarray:
    """Return the rotations closest to matrices, shape (..., 3, 3).

    Of the moments ``target.T @ points``, it is the rotation that turns the points to the target (Kabsch 1976).

    Args:
        matrices: shape (..., 3, 3).
    """
    left, _, right = np.linalg.svd(matrices)
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    return left @ right


def similarity_of_points(points: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the rotation and the scale that map points to others best, both relative to their means (Umeyama 1991).

    Args:
        points: shape (point, 3).
        target: shape (point, 3).

    Returns:
        Rotation, shape (3, 3), and scale; 1 if all points are equal.
    """
    a, b = points - points.mean(axis=0), target - target.mean(axis=0)
    rotation = closest_rotation(b.T @ a)
    spread = float(np.square(a).sum())
    return rotation, float((b * (a @ rotation.T)).sum()) / spread if spread > 0.0 else 1.0
