"""Kinematic tree of bodies without one: bones between keypoints that keep their distance."""

import numpy as np

from posefuse.errors import SkeletonError
from posefuse.model.graphs import connected_components
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import Tree
from posefuse.skeleton.trees_from_edges import spanning_tree

_MIN_BODIES = 5
"""Number of bodies that must show a distance for it to be measured."""
_LENGTH_PENALTY = 0.1
"""Share of a distance that counts as variation, so that the shorter of two equally constant distances is the bone."""
_EDGE_FACTOR = 1e-3
"""Factor for the variation of the skeleton's edges, which makes them bones before any other distance."""
_SPREAD = 0.2
_MEDIAN_OF_NOISE = 2.0 * np.log(2.0) / 3.0
"""Median of the squared noise across a bone, which has two of three axes, relative to the trace of its covariance."""
_SIGMA_OF_MAD = 1.4826
_MAX_NOISE_RATIO = 4.0
"""Variance of a constant distance relative to that of its noise, at most."""


def measured_tree(
    skeleton: Skeleton, points_m: np.ndarray, covariance_m2: np.ndarray, max_variation: float = np.inf
) -> Tree:
    """Measure the tree of bones from bodies triangulated one keypoint at a time.

    Bones are the skeleton's edges and, where these are missing or leave keypoints out, the minimum spanning tree of the
    variation of distances. A length is the square root of the median squared distance minus its noise, because noise
    across a bone increases distances; only the half of the bodies with the smaller uncertainty counts.

    Args:
        skeleton: Skeleton of the keypoints.
        points_m: shape (body, keypoint, 3), NaN where missing; bodies of any individuals and frames.
        covariance_m2: shape (body, keypoint, 6).
        max_variation: A distance that varies by more than this share of its length, and by more than its noise, is no
            bone unless it is an edge.

    Raises:
        SkeletonError: If too few bodies show a distance.
    """
    from scipy.sparse.csgraph import minimum_spanning_tree  # Live tracking does not need it, nor its 0.2 s to load.

    lengths, variation, noise = _distances(points_m, covariance_m2)
    edges = skeleton.edge_indices
    weight = variation + _LENGTH_PENALTY * lengths
    weight[edges[:, 0], edges[:, 1]] *= _EDGE_FACTOR
    weight[edges[:, 1], edges[:, 0]] *= _EDGE_FACTOR
    elastic = variation**2 > (max_variation * lengths) ** 2 + _MAX_NOISE_RATIO * noise
    elastic[edges[:, 0], edges[:, 1]] = elastic[edges[:, 1], edges[:, 0]] = False
    weight[elastic | ~np.isfinite(weight)] = 0.0
    bones = _of_largest_part(minimum_spanning_tree(weight).toarray() > 0.0)
    if not len(bones):
        raise SkeletonError(
            f"Skeleton {skeleton.name!r} has no kinematic tree, and bones cannot be measured: of the {len(points_m)} "
            f"bodies that several views show, fewer than {_MIN_BODIES} show any two keypoints together. "
            "Add a table [tree] to its TOML file with at least size_m, the size of the body in meters; "
            "see docs/formats.md."
        )
    size = float(np.nanmax(lengths))
    return spanning_tree(
        skeleton.keypoints, bones, lengths[bones[:, 0], bones[:, 1]], _SPREAD, size, np.asarray(skeleton.mirror)
    )


def _distances(points: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return distances between keypoints, their variation and the variance of their noise, NaN where unknown.

    Each has the shape (keypoint, keypoint).
    """
    n = points.shape[1]
    noise = covariance[..., (0, 3, 5)].sum(axis=-1)
    lengths, variation, along = (np.full((n, n), np.nan) for _ in range(3))
    for a in range(n):
        for b in range(a + 1, n):
            squared, doubt = ((points[:, a] - points[:, b]) ** 2).sum(axis=-1), noise[:, a] + noise[:, b]
            seen = np.isfinite(squared)
            if seen.sum() < _MIN_BODIES:
                continue
            seen &= doubt <= np.median(doubt[seen])
            length = np.sqrt(max(float(np.median(squared[seen] - _MEDIAN_OF_NOISE * doubt[seen])), 0.0))
            apart = np.sqrt(squared[seen])
            # If the noise exceeds the distance, use the median distance without a correction.
            lengths[a, b] = lengths[b, a] = length if length > 0.0 else float(np.median(apart))
            spread = _SIGMA_OF_MAD * np.median(np.abs(apart - np.median(apart)))
            variation[a, b] = variation[b, a] = spread
            along[a, b] = along[b, a] = np.median(doubt[seen]) / 3.0
    return lengths, variation, along


def _of_largest_part(joined: np.ndarray) -> np.ndarray:
    """Return the pairs of the largest connected component, shape (bone, 2)."""
    part = connected_components(joined)
    largest = np.bincount(part).argmax()
    pairs = np.argwhere(joined)
    return pairs[part[pairs[:, 0]] == largest]
