"""Core poses of proposals, and the distance d_prop between them.

Source: the specification of the articulated tracker, see docs/methods/specification.md.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from posefuse.association.trunk import full
from posefuse.model.options.specification import SpecificationOptions
from posefuse.skeleton.skeletons import Skeleton


@dataclass(frozen=True, eq=False)
class CorePoses:
    """Roots of people, and their core keypoints relative to the root.

    Attributes:
        root_m: shape (..., 3).
        root_covariance_m2: shape (..., 3, 3).
        core_m: shape (..., core, 3), NaN where missing.
        core_covariance_m2: shape (..., core, 3, 3): of the keypoints relative to the root.
    """

    root_m: np.ndarray
    root_covariance_m2: np.ndarray
    core_m: np.ndarray
    core_covariance_m2: np.ndarray

    def select(self, index: Any) -> "CorePoses":
        """Return some of the poses, or with additional axes, given by an index of their first axes."""
        return CorePoses(*(each[index] for each in vars(self).values()))


def core_poses(points_m: np.ndarray, covariance_m2: np.ndarray, skeleton: Skeleton) -> CorePoses:
    """Return roots and relative core keypoints of people.

    The root is the keypoint at the root of the tree, or the mean of the core keypoints where there is none.

    Args:
        points_m: shape (..., keypoint, 3), NaN where missing.
        covariance_m2: shape (..., keypoint, 6).
        skeleton: Skeleton of the keypoints.
    """
    core, spread = points_m[..., skeleton.core_indices, :], full(covariance_m2)[..., skeleton.core_indices, :, :]
    finite = np.asarray(np.isfinite(core).all(axis=-1))
    count = np.maximum(finite.sum(axis=-1), 1)[..., None]
    root = np.where(finite[..., None], core, 0.0).sum(axis=-2) / count
    root_spread = np.where(finite[..., None, None], spread, 0.0).sum(axis=-3) / count[..., None] ** 2
    node = np.empty(0, dtype=np.int64)
    if skeleton.tree is not None:
        node = np.flatnonzero(skeleton.tree.keypoint_nodes == 0)
    if len(node):
        pelvis = points_m[..., node[0], :]
        shown = np.asarray(np.isfinite(pelvis).all(axis=-1))[..., None]
        root = np.where(shown, pelvis, root)
        root_spread = np.where(shown[..., None], full(covariance_m2)[..., node[0], :, :], root_spread)
    return CorePoses(root, root_spread, core - root[..., None, :], spread + root_spread[..., None, :, :])


def proposal_distance(one: CorePoses, other: CorePoses, options: SpecificationOptions) -> np.ndarray:
    """Return d_prop: |r - r'|^2 / tau_r^2 + lambda_Z sum |Z - Z'|^2 / tau_Z^2.

    With ``normalized_distance``, the squared scale tau^2 of each difference is replaced by the matrix tau^2 I plus the
    covariances of both poses, so that uncertain depths count less.

    Args:
        one: Core poses, broadcast against ``other``.
        other: Core poses.
        options: Scales and weights.

    Returns:
        shape (...), dimensionless; the sum is over the core keypoints that both have, inf where there are none.
    """
    between = np.zeros(()) if not options.normalized_distance else one.root_covariance_m2 + other.root_covariance_m2
    moved = _squared(one.root_m - other.root_m, between, options.tau_root_m)
    if options.normalized_distance:
        between = one.core_covariance_m2 + other.core_covariance_m2
    squared = _squared(one.core_m - other.core_m, between, options.tau_core_m)
    common = np.isfinite(squared)
    total = moved + options.core_weight * np.where(common, squared, 0.0).sum(axis=-1)
    return np.where(common.any(axis=-1), total, np.inf)


def _squared(difference: np.ndarray, covariance: np.ndarray, tau_m: float) -> np.ndarray:
    """Return squared distances in units of tau and a covariance, shape (...); NaN where a difference is unknown."""
    if not covariance.ndim:
        return (difference**2).sum(axis=-1) / tau_m**2
    known = np.asarray(np.isfinite(difference).all(axis=-1) & np.isfinite(covariance).all(axis=(-2, -1)))
    matrix = np.where(known[..., None, None], covariance, 0.0) + tau_m**2 * np.eye(3)
    vector = np.where(known[..., None], difference, 0.0)
    squared = (vector * np.linalg.solve(matrix, vector[..., None])[..., 0]).sum(axis=-1)
    return np.where(known, squared, np.nan)
