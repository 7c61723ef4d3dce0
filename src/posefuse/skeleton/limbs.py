"""Limbs of a skeleton: pairs of keypoints whose distance a body model keeps constant."""

from dataclasses import dataclass

import numpy as np

from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import Node, Tree


@dataclass(frozen=True, eq=False)
class Limbs:
    """Pairs of keypoints at a constant distance: the ends of a bone, or two points of a segment.

    Attributes:
        keypoints: shape (limb, 2), int64: the two keypoints.
        nodes: shape (limb, 2), int64: their nodes in the tree.
        mirror: shape (limb,), int64: the limb of the other side, or the limb itself.
    """

    keypoints: np.ndarray
    nodes: np.ndarray
    mirror: np.ndarray

    def __len__(self) -> int:
        return len(self.keypoints)

    def lengths_m(self, tree: Tree, shape_m: np.ndarray) -> np.ndarray:
        """Return the lengths of the limbs of a body, shape (..., limb).

        Args:
            tree: Tree of the skeleton.
            shape_m: shape (..., shape).
        """
        _, _, _, places, shape_of, signs, _, _ = tree.packed
        zero = np.zeros((*np.shape(shape_m)[:-1], 1))
        own = signs * np.concatenate([shape_m, zero], axis=-1)[..., shape_of]
        offsets = np.where(shape_of >= 0, own, places)
        first, second = self.nodes.T
        is_origin = np.array([tree.nodes[n].parent for n in second], dtype=np.int64) == first
        start = np.where(is_origin[:, None], 0.0, offsets[..., first, :])
        return np.linalg.norm(offsets[..., second, :] - start, axis=-1)


def core_limbs(skeleton: Skeleton, tree: Tree) -> Limbs:
    """Return the limbs between core keypoints.

    Args:
        skeleton: The skeleton.
        tree: Its tree, or another one with the same nodes.
    """
    core = [int(k) for k in skeleton.core_indices if tree.keypoint_nodes[k] >= 0]
    nodes = {k: int(tree.keypoint_nodes[k]) for k in core}
    return _limbs(skeleton, nodes, [(i, j) for i in core for j in core if _is_limb(tree.nodes, nodes[i], nodes[j])])


def edge_limbs(skeleton: Skeleton, tree: Tree) -> Limbs:
    """Return the limbs among the edges of a skeleton.

    Args:
        skeleton: The skeleton.
        tree: Its tree, or another one with the same nodes.
    """
    nodes = {k: int(n) for k, n in enumerate(tree.keypoint_nodes) if n >= 0}
    edges = [(int(i), int(j)) for i, j in skeleton.edge_indices if int(i) in nodes and int(j) in nodes]
    both = [pair for i, j in edges for pair in ((i, j), (j, i))]
    found = [(i, j) for i, j in both if _is_rigid(tree.nodes, nodes[i], nodes[j])]
    return _limbs(skeleton, nodes, list(dict.fromkeys(found)))


def _limbs(skeleton: Skeleton, node_of: dict[int, int], found: list[tuple[int, int]]) -> Limbs:
    """Return limbs by their pairs of keypoints."""
    places = {frozenset(pair): n for n, pair in enumerate(found)}
    mirrored = [frozenset(int(skeleton.mirror[k]) for k in pair) for pair in found]
    return Limbs(
        np.array(found, dtype=np.int64).reshape(-1, 2),
        np.array([[node_of[i], node_of[j]] for i, j in found], dtype=np.int64).reshape(-1, 2),
        np.array([places.get(pair, n) for n, pair in enumerate(mirrored)], dtype=np.int64),
    )


def _is_limb(nodes: tuple[Node, ...], first: int, second: int) -> bool:
    """Return whether two nodes are the ends of a bone, the near one first, or two points of a segment, in order."""
    a, b = nodes[first], nodes[second]
    if b.is_bone:
        return b.parent == first
    same_segment = a.parent == b.parent >= 0 and a.mover == b.mover
    return not a.is_bone and same_segment and first < second


def _is_rigid(nodes: tuple[Node, ...], first: int, second: int) -> bool:
    """Return whether two nodes form a limb, or the second is a point of a segment that begins at the first."""
    return nodes[second].parent == first or _is_limb(nodes, first, second)
