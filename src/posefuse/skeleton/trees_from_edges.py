"""Trees of freely rotating bones, built from the edges of a skeleton without a tree."""

from collections.abc import Sequence

import numpy as np

from posefuse.arrays import frozen
from posefuse.skeleton.trees import CONSTANT, DOWN, UNREFLECTED, Node, Tree

_EDGE_SHARE, _EDGE_SPREAD = 0.25, 0.5
"""Prior of a bone length if only the body size is known: fraction of the size, and its relative spread."""
_STAYS = (0.0, 0.0, 0.0)


def spanning_tree(
    keypoints: Sequence[str], edges: np.ndarray, lengths_m: np.ndarray, spread: float, size_m: float, mirror: np.ndarray
) -> Tree:
    """Build a tree whose bones are the edges of a skeleton.

    The keypoint with the most edges is the root. Keypoints that are not connected to it have no node, and an edge that
    closes a loop is not a bone. Symmetric bones share one length.

    Args:
        keypoints: names of the keypoints.
        edges: shape (edge, 2), int.
        lengths_m: shape (edge,): lengths of the bones.
        spread: relative standard deviation of lengths, each and all together.
        size_m: body size.
        mirror: shape (keypoint,), int: index of each keypoint's mirror image, or of itself.
    """
    neighbors: list[list[tuple[int, float]]] = [[] for _ in keypoints]
    for (a, b), length in zip(edges.tolist(), lengths_m.tolist(), strict=True):
        neighbors[a].append((b, length))
        neighbors[b].append((a, length))
    root = int(np.argmax([len(of) for of in neighbors]))
    nodes = [Node(keypoints[root], -1, 0, False, _STAYS, CONSTANT, UNREFLECTED)]
    place_of, number_of = {root: 0}, dict[frozenset[int], int]()
    bones: list[str] = []
    names: list[str] = []
    shape: list[float] = []
    order = [root]
    for here in order:
        for other, length in neighbors[here]:
            if other in place_of:
                continue
            place_of[other] = len(nodes)
            number = number_of.get(frozenset((int(mirror[here]), int(mirror[other]))), len(shape))
            if number == len(shape):
                shape.append(length)
                names.append(keypoints[other])
            number_of[frozenset((here, other))] = number
            place = (0.0, 0.0, shape[number])
            nodes.append(Node(keypoints[other], place_of[here], len(bones), True, place, (-1, -1, number), UNREFLECTED))
            bones.append(keypoints[other])
            order.append(other)
    values = np.array(shape)
    return Tree(
        segments=(),
        bones=tuple(bones),
        nodes=tuple(nodes),
        limits=(),
        shape_names=tuple(names),
        shape_m=frozen(values),
        shape_covariance=frozen(spread**2 * (np.diag(values**2) + np.outer(values, values))),
        keypoint_nodes=frozen(np.array([place_of.get(k, -1) for k in range(len(keypoints))]), np.int64),
        rest=frozen(np.tile(DOWN, (len(bones), 1))),
        size_m=size_m,
    )


def tree_of_size(keypoints: Sequence[str], edges: np.ndarray, size_m: float, mirror: np.ndarray) -> Tree:
    """Build a tree from edges and the body size; bone lengths are uncertain by about a factor of two.

    Args:
        keypoints: names of the keypoints.
        edges: shape (edge, 2), int.
        size_m: body size.
        mirror: shape (keypoint,), int: index of each keypoint's mirror image, or of itself.
    """
    return spanning_tree(keypoints, edges, np.full(len(edges), _EDGE_SHARE * size_m), _EDGE_SPREAD, size_m, mirror)
