"""Rotations of vectors and quaternions, and rotations that fit matrices and points."""

import numpy as np

_SMALL_ANGLE = 1e-3


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


def rotations_from_vectors(vectors: np.ndarray) -> np.ndarray:
    """Return the rotation matrices, shape (..., 3, 3), of Rodrigues vectors (axis times angle in radians).

    Args:
        vectors: shape (..., 3).
    """
    x, y, z = np.moveaxis(vectors, -1, 0)
    angle = np.sqrt(x * x + y * y + z * z)
    squared, small = angle * angle, angle <= _SMALL_ANGLE
    # sin(a/2)/a
    series = 0.5 - squared / 48.0 + squared * squared / 3840.0
    scale = np.where(small, series, np.sin(0.5 * angle) / np.where(small, 1.0, angle))
    return _matrices(scale * x, scale * y, scale * z, np.cos(0.5 * angle))


def rotations_from_quaternions(quaternions: np.ndarray) -> np.ndarray:
    """Return the rotation matrices, shape (..., 3, 3), of quaternions of any length.

    Args:
        quaternions: shape (..., 4): x, y, z and, last, the scalar.
    """
    unit = quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)
    return _matrices(*np.moveaxis(unit, -1, 0))


def _matrices(x: np.ndarray, y: np.ndarray, z: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return the matrices of unit quaternions."""
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, xz, yz, xw, yw, zw = x * y, x * z, y * z, x * w, y * w, z * w
    found = np.empty((*np.shape(x), 3, 3))
    found[..., 0, 0], found[..., 0, 1], found[..., 0, 2] = xx - yy - zz + ww, 2.0 * (xy - zw), 2.0 * (xz + yw)
    found[..., 1, 0], found[..., 1, 1], found[..., 1, 2] = 2.0 * (xy + zw), yy - xx - zz + ww, 2.0 * (yz - xw)
    found[..., 2, 0], found[..., 2, 1], found[..., 2, 2] = 2.0 * (xz - yw), 2.0 * (yz + xw), -xx - yy + zz + ww
    return found
