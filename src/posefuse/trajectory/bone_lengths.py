"""Lengths of bones from measured lengths and from the distribution of bodies."""

from dataclasses import dataclass

import numpy as np

from posefuse.skeleton.limbs import edge_limbs
from posefuse.skeleton.skeletons import Skeleton
from posefuse.trajectory.bones import Bones

_SIDE_SHARE = 0.02
"""Standard deviation of the difference between the same bone of both sides, as a share of its length."""

_KEYPOINT_SHARE = 0.1
"""Standard deviation of the distance between two keypoints of a detector for a given body, as a share of the length:
detectors place keypoints differently."""

_UNKNOWN_SHARE = 10.0
"""Standard deviation of a length without a distribution, as a share of the measured length."""


@dataclass(frozen=True, eq=False)
class LengthPrior:
    """Gaussian distribution of the bone lengths of a subject.

    Attributes:
        mean_m: shape (bone,); NaN for bones that the body model lacks.
        covariance_m2: shape (bone, bone); 0 for bones that the body model lacks.
        mirror: shape (bone,), int64: the same bone of the other side, or the bone itself.
    """

    mean_m: np.ndarray
    covariance_m2: np.ndarray
    mirror: np.ndarray

    @classmethod
    def of(cls, skeleton: Skeleton, bones: Bones) -> "LengthPrior":
        """Return the distribution of the bones of a skeleton: that of its body model, where it has one."""
        number = {frozenset(map(int, ends)): n for n, ends in enumerate(bones.ends)}
        other = [frozenset(int(skeleton.mirror[k]) for k in ends) for ends in bones.ends]
        mirror = np.array([number.get(ends, n) for n, ends in enumerate(other)], dtype=np.int64)
        mean = np.full(len(bones.ends), np.nan)
        covariance = np.zeros((len(bones.ends), len(bones.ends)))
        tree = skeleton.tree
        if tree is None:
            return cls(mean, covariance, mirror)
        limbs = edge_limbs(skeleton, tree)
        known = [(n, number[pair]) for n, pair in enumerate(map(_pair, limbs.keypoints)) if pair in number]
        if not known:
            return cls(mean, covariance, mirror)
        limb, bone = np.array(known, dtype=np.int64).T
        lengths = limbs.lengths_m(tree, tree.shape_m)
        step = 1e-4 * tree.size_m
        slope = (limbs.lengths_m(tree, tree.shape_m + step * np.eye(tree.n_shape)) - lengths) / step
        mean[bone] = lengths[limb]
        covariance[np.ix_(bone, bone)] = slope[:, limb].T @ tree.shape_covariance @ slope[:, limb]
        return cls(mean, covariance, mirror)

    def posterior_m(self, measured_m: np.ndarray, sd_m: np.ndarray) -> np.ndarray:
        """Return the mean of each length given measurements, shape (bone,); NaN where it was not measured.

        Both sides have nearly equal lengths.

        Args:
            measured_m: shape (bone,): measured lengths; NaN where unknown.
            sd_m: shape (bone,): standard deviations of their errors.
        """
        known = np.isfinite(measured_m) & np.isfinite(sd_m)
        out = np.full(len(known), np.nan)
        if not known.any():
            return out
        has_prior = np.isfinite(self.mean_m[known])
        opposite = measured_m[self.mirror]
        both = 0.5 * (measured_m + np.where(np.isfinite(opposite), opposite, measured_m))
        typical = np.where(has_prior, self.mean_m[known], both[known])
        shared = np.square(np.where(has_prior, _KEYPOINT_SHARE, _UNKNOWN_SHARE) * typical)
        is_opposite = self.mirror[known][:, None] == np.flatnonzero(known)[None, :]
        prior = self.covariance_m2[np.ix_(known, known)] + np.where(
            is_opposite, np.sqrt(shared[:, None] * shared[None, :]), 0.0
        )
        single = np.where(np.diag(is_opposite), 0.0, shared)
        prior[np.diag_indices(len(typical))] += single + 0.5 * np.square(_SIDE_SHARE * typical)
        gain = np.linalg.solve(prior + np.diag(np.square(sd_m[known])), prior).T
        out[known] = typical + gain @ (measured_m[known] - typical)
        return out


def _pair(keypoints: np.ndarray) -> frozenset[int]:
    return frozenset(int(k) for k in keypoints)
