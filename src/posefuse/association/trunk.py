"""Center of a trunk, from shoulders and hips, any of which may be missing or wrong.

The four points are modeled as ``c + h + s, c + h - s, c - h + (2/3 s + q), c - h - (2/3 s + q)`` (left and right
shoulder, left and right hip): the center c is unknown; the half height h and the half shoulder width s are normally
distributed about 0 with the sizes of an adult in any direction, and so is q, the deviation of the hips from a line
parallel to the shoulders and two thirds as wide. The model is linear, so c and its covariance have a closed form;
missing points increase the covariance. Points that do not fit get less weight (Student's t, 3 degrees of freedom). The
pelvis keypoint is the least accurate landmark and is not used.

For a skeleton without shoulders and hips, the core keypoints are used instead, each anywhere around the center.
"""

import numpy as np

from posefuse.kernels.association.trunks import estimate_trunk_centers
from posefuse.skeleton.skeletons import Skeleton

_TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
_HIPS = 2.0 / 3.0
# Columns: c, h, s, q.
_DESIGN = np.array([[1.0, 1.0, 1.0, 0.0], [1.0, 1.0, -1.0, 0.0], [1.0, -1.0, _HIPS, 1.0], [1.0, -1.0, -_HIPS, -1.0]])
# Standard deviations of c, h, s and q in meters; c has a flat prior.
_SIZES_M = np.array([100.0, 0.26, 0.2, 0.07])
# Standard deviation of a landmark beyond that of its rays, for an adult human: detectors differ in where a hip is.
_FLOOR_M = 0.02


def torso(skeleton: Skeleton, points_m: np.ndarray, covariance_m2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the center of the trunk.

    Args:
        skeleton: Skeleton of the keypoints.
        points_m: shape (person, keypoint, 3), NaN where missing.
        covariance_m2: shape (person, keypoint, 6).

    Returns:
        Positions, shape (person, 3), and covariances, shape (person, 6); NaN for a person whose
        trunk or core keypoints are all missing.
    """
    if all(name in skeleton.keypoints for name in _TRUNK):
        chosen = np.array([skeleton.index(name) for name in _TRUNK])
        middles, spreads = np.empty((len(points_m), 3)), np.empty((len(points_m), 6))
        estimate_trunk_centers(
            points_m, np.ascontiguousarray(covariance_m2), chosen, _DESIGN, _SIZES_M, _FLOOR_M, middles, spreads
        )
        return middles, spreads
    floor_m = _FLOOR_M * (1.0 if skeleton.tree is None else skeleton.tree.scale)
    return _middle(points_m[:, skeleton.core_indices], floor_m)


def _middle(points: np.ndarray, floor_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the median of the points per axis, with a covariance from their scatter."""
    seen = np.asarray(np.isfinite(points).all(axis=-1))
    out, spread = np.full((len(points), 3), np.nan), np.full((len(points), 6), np.nan)
    for i in range(len(points)):
        if seen[i].any():
            own = points[i, seen[i]]
            out[i] = np.median(own, axis=0)
            variance = np.mean((own - out[i]) ** 2) + floor_m**2
            # The variance of the median of n normal numbers is pi / 2 times that of their mean.
            spread[i] = six(np.eye(3) * variance * np.pi / 2.0 / len(own))
    return out, spread


def full(covariance: np.ndarray) -> np.ndarray:
    """Return symmetric matrices from their six elements: (..., 6) to (..., 3, 3)."""
    return np.asarray(covariance)[..., [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


def six(matrices: np.ndarray) -> np.ndarray:
    """Return the six elements xx xy xz yy yz zz of symmetric matrices: (..., 3, 3) to (..., 6)."""
    return np.asarray(matrices)[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
