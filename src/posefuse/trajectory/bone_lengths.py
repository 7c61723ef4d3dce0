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

_IMPLAUSIBLE = 4.0
"""Number of standard deviations of the logarithm of the size beyond which another unit of length, or a very small or
large subject, is more probable. The proportions of bodies still apply."""

_MEDIAN_VARIANCE = 0.5 * np.pi
"""Variance of the median of normal numbers over that of their mean."""

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

        Both sides have nearly equal lengths. The result is in the unit of the measurements: where bodies of another
        size are measured, the distribution is scaled to that size.

        Args:
            measured_m: shape (bone,): measured lengths; NaN where unknown.
            sd_m: shape (bone,): standard deviations of their errors.
        """
        known = np.isfinite(measured_m) & np.isfinite(sd_m)
        out = np.full(len(known), np.nan)
        if not known.any():
            return out
        has_prior = np.isfinite(self.mean_m[known])
        size = self._size(measured_m, sd_m)
        opposite = measured_m[self.mirror]
        both = 0.5 * (measured_m + np.where(np.isfinite(opposite), opposite, measured_m))
        typical = np.where(has_prior, size * self.mean_m[known], both[known])
        shared = np.square(np.where(has_prior, _KEYPOINT_SHARE, _UNKNOWN_SHARE) * typical)
        is_opposite = self.mirror[known][:, None] == np.flatnonzero(known)[None, :]
        prior = size**2 * self.covariance_m2[np.ix_(known, known)] + np.where(
            is_opposite, np.sqrt(shared[:, None] * shared[None, :]), 0.0
        )
        single = np.where(np.diag(is_opposite), 0.0, shared)
        prior[np.diag_indices(len(typical))] += single + 0.5 * np.square(_SIDE_SHARE * typical)
        gain = np.linalg.solve(prior + np.diag(np.square(sd_m[known])), prior).T
        out[known] = typical + gain @ (measured_m[known] - typical)
        return out

    def _size(self, measured_m: np.ndarray, sd_m: np.ndarray) -> float:
        """Return the size of the measured subject relative to the bodies of the distribution; 1 if it is plausible."""
        known = (measured_m > 0.0) & np.isfinite(sd_m) & np.isfinite(self.mean_m)
        if not known.any():
            return 1.0
        mean_m = self.mean_m[known]
        size = float(np.median(measured_m[known] / mean_m))
        of_bodies = self.covariance_m2[np.ix_(known, known)].sum() / mean_m.sum() ** 2
        # Of one bone: its error, and the places of its keypoints.
        of_bone = np.square(sd_m[known] / (size * mean_m)).mean() + _KEYPOINT_SHARE**2
        variance = of_bodies + _MEDIAN_VARIANCE * of_bone / known.sum()
        return 1.0 if abs(np.log(size)) <= _IMPLAUSIBLE * np.sqrt(variance) else size


def _pair(keypoints: np.ndarray) -> frozenset[int]:
    return frozenset(int(k) for k in keypoints)
