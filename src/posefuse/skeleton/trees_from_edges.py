"""Trees of bones made from a skeleton's edges, where it says nothing of how they turn."""

from collections.abc import Sequence

import numpy as np

from posefuse.arrays import frozen
from posefuse.skeleton.trees import DOWN, NOBODYS, PLAIN, Node, Tree

_EDGE_SHARE, _EDGE_SPREAD = 0.25, 0.5
"""Of a body of which only the size is known: how long a bone is as a share of it, and by which share that is off."""
_STAYS = (0.0, 0.0, 0.0)


def spanning_tree(
    keypoints: Sequence[str], edges: np.ndarray, lengths_m: np.ndarray, spread: float, size_m: float, mirror: np.ndarray
) -> Tree:
    """The bones that edges are, for skeletons that say nothing of how they turn.

    The keypoint of most edges is the root. Keypoints that no edges connect with it have no node, and an edge that
    closes a ring is no bone. Bones that mirror each other are of one length.

    Args:
        keypoints: names.
        edges: shape (edge, 2), int.
        lengths_m: shape (edge,): of the bones.
        spread: by which share lengths are off, each by itself and all together.
        size_m: of the body.
        mirror: shape (keypoint,), int: each keypoint's partner on the other side, else itself.
    """
    neighbours: list[list[tuple[int, float]]] = [[] for _ in keypoints]
    for (a, b), length in zip(edges.tolist(), lengths_m.tolist(), strict=True):
        neighbours[a].append((b, length))
        neighbours[b].append((a, length))
    root = int(np.argmax([len(of) for of in neighbours]))
    nodes = [Node(keypoints[root], -1, 0, False, _STAYS, NOBODYS, PLAIN)]
    place_of, number_of = {root: 0}, dict[frozenset[int], int]()
    bones: list[str] = []
    names: list[str] = []
    shape: list[float] = []
    order = [root]
    for here in order:
        for other, length in neighbours[here]:
            if other in place_of:
                continue
            place_of[other] = len(nodes)
            number = number_of.get(frozenset((int(mirror[here]), int(mirror[other]))), len(shape))
            if number == len(shape):
                shape.append(length)
                names.append(keypoints[other])
            number_of[frozenset((here, other))] = number
            place = (0.0, 0.0, shape[number])
            nodes.append(Node(keypoints[other], place_of[here], len(bones), True, place, (-1, -1, number), PLAIN))
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
    """The bones that edges are, of a body of which only the size is known: any of them may be half as long, or twice.

    Args:
        keypoints: names.
        edges: shape (edge, 2), int.
        size_m: from end to end.
        mirror: shape (keypoint,), int: each keypoint's partner on the other side, else itself.
    """
    return spanning_tree(keypoints, edges, np.full(len(edges), _EDGE_SHARE * size_m), _EDGE_SPREAD, size_m, mirror)
