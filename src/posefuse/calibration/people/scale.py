"""Approximate scale of a world by the size of people."""

import numpy as np

from posefuse.skeleton.limbs import core_limbs
from posefuse.skeleton.skeletons import Skeleton

_SIZE_M = 1.7
_SPREAD_TO_SIZE = 3.5


def meters_per_unit(skeleton: Skeleton, keypoints: np.ndarray, points: np.ndarray) -> float:
    """Return the factor that makes people as large as the skeleton states, or 1.7 m.

    Args:
        skeleton: the skeleton; its tree gives the lengths of limbs.
        keypoints: shape (keypoint,): indices of the keypoints.
        points: shape (sample, keypoint, 3), NaN where unknown.
    """
    place = {int(k): i for i, k in enumerate(keypoints)}
    if skeleton.tree is not None:
        limbs = core_limbs(skeleton, skeleton.tree)
        expected_m = limbs.lengths_m(skeleton.tree, skeleton.tree.shape_m)
        ratios = []
        for (a, b), length_m in zip(limbs.keypoints, expected_m, strict=True):
            if int(a) in place and int(b) in place:
                lengths = np.linalg.norm(points[:, place[int(a)]] - points[:, place[int(b)]], axis=-1)
                if np.isfinite(lengths).any():
                    ratios.append(length_m / np.nanmedian(lengths))
        if ratios:
            return float(np.median(ratios))
    center = np.nanmean(points, axis=1, keepdims=True)
    return _SIZE_M / (_SPREAD_TO_SIZE * float(np.sqrt(np.nanmedian(((points - center) ** 2).sum(axis=-1)))))
