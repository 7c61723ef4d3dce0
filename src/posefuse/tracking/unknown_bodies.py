"""A tree for bodies of which nobody has said how they move: bones between keypoints that keep their distance."""

import numpy as np
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from posefuse.errors import SkeletonError
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import Tree
from posefuse.skeleton.trees_from_edges import spanning_tree

_FEWEST = 5
"""So many bodies must show a distance for it to be measured."""
_NEARNESS = 0.1
"""Of two distances that keep as well, the shorter is the bone: this share of it counts as variation."""
_EDGE_BONUS = 1e-3
"""An edge of the skeleton is a bone before any other distance is."""
_SPREAD = 0.2
_LONGER = 2.0 * np.log(2.0) / 3.0
"""Two of three axes lie across a bone; a sum of two squared normal numbers has this median, times their variance."""
_SIGMA_OF_MAD = 1.4826


def measured_tree(skeleton: Skeleton, points_m: np.ndarray, covariance_m2: np.ndarray) -> Tree:
    """The tree of bones that bodies have, from bodies triangulated keypoint by keypoint.

    Bones are the skeleton's edges, and, where these leave keypoints out or are not given, the tree of distances that
    vary least (a minimum spanning tree). A length is the root of the median squared distance less its noise, since
    noise across makes distances longer; the half of the bodies that know it better decide.

    Args:
        skeleton: of the keypoints.
        points_m: shape (body, keypoint, 3), NaN where missing: of any animals and frames.
        covariance_m2: shape (body, keypoint, 6).

    Raises:
        SkeletonError: if too few bodies were seen.
    """
    lengths, variation = _distances(points_m, covariance_m2)
    edges = skeleton.edge_indices
    weight = variation + _NEARNESS * lengths
    weight[edges[:, 0], edges[:, 1]] *= _EDGE_BONUS
    weight[edges[:, 1], edges[:, 0]] *= _EDGE_BONUS
    weight[~np.isfinite(weight)] = 0.0
    bones = _of_largest_part(minimum_spanning_tree(weight).toarray() > 0.0)
    if not len(bones):
        raise SkeletonError(
            f"Skeleton {skeleton.name!r} has no tree, and of {len(points_m)} bodies that several views show no two "
            f"keypoints are seen together {_FEWEST} times, so that no bones can be measured. Add a table [tree] to its "
            "TOML, or at least how large the body is, in metres, as size_m in that table; see docs/formats.md."
        )
    size = float(np.nanmax(lengths))
    return spanning_tree(
        skeleton.keypoints, bones, lengths[bones[:, 0], bones[:, 1]], _SPREAD, size, np.asarray(skeleton.mirror)
    )


def _distances(points: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of every two keypoints how far apart they are, and by how much that varies: shape (keypoint, keypoint), NaN."""
    n = points.shape[1]
    noise = covariance[..., (0, 3, 5)].sum(axis=-1)
    lengths, variation = np.full((n, n), np.nan), np.full((n, n), np.nan)
    for a in range(n):
        for b in range(a + 1, n):
            squared, doubt = ((points[:, a] - points[:, b]) ** 2).sum(axis=-1), noise[:, a] + noise[:, b]
            seen = np.isfinite(squared)
            if seen.sum() < _FEWEST:
                continue
            seen &= doubt <= np.median(doubt[seen])
            length = np.sqrt(max(float(np.median(squared[seen] - _LONGER * doubt[seen])), 0.0))
            apart = np.sqrt(squared[seen])
            # Noise that is longer than the distance leaves nothing to subtract it from.
            lengths[a, b] = lengths[b, a] = length if length > 0.0 else float(np.median(apart))
            spread = _SIGMA_OF_MAD * np.median(np.abs(apart - np.median(apart)))
            variation[a, b] = variation[b, a] = spread
    return lengths, variation


def _of_largest_part(joined: np.ndarray) -> np.ndarray:
    """The pairs, shape (bone, 2), that connect the most keypoints with each other."""
    _, part = connected_components(joined, directed=False)
    largest = np.bincount(part).argmax()
    pairs = np.argwhere(joined)
    return pairs[part[pairs[:, 0]] == largest]
