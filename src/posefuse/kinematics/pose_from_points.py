"""How bodies stand by their points alone, where none was fitted to them."""

import numpy as np

from posefuse.kinematics.initial_pose import places_of
from posefuse.skeleton.trees import Tree

_FEWEST = 2
_NEIGHBOUR_WEIGHT = 0.1
_CARRIER_SHARE = 1e-3
"""How much the carrier's turn counts beside a segment's points: it decides only what they leave open."""


def shown_pose(tree: Tree, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turns of segments and directions of bones that points show.

    A segment is turned as its points lie, with the one it turns about, by least squares to where they are in an average
    body (Kabsch 1976); the root by what rides beside it too. A bone points from one end to the other.

    Args:
        tree: of the body.
        points_m: shape (..., keypoint, 3), NaN where unknown.

    Returns:
        Turns, shape (..., segment, 3, 3), NaN where fewer than two points show a segment, and directions, shape
        (..., bone, 3), NaN where an end is unknown.
    """
    known = _of_nodes(tree, points_m.reshape(-1, *points_m.shape[-2:]))
    turns = np.full((len(known), len(tree.segments), 3, 3), np.nan)
    for segment in range(len(tree.segments)):
        turns[:, segment] = _turn(tree, segment, known, turns)
    directions = np.full((len(known), len(tree.bones), 3), np.nan)
    for n, node in enumerate(tree.nodes):
        if node.is_bone:
            along = known[:, n] - known[:, node.parent]
            length = np.linalg.norm(along, axis=-1, keepdims=True)
            directions[:, node.mover] = along / np.where(length > 0.0, length, np.nan)
    shape = points_m.shape[:-2]
    return turns.reshape(*shape, *turns.shape[1:]), directions.reshape(*shape, *directions.shape[1:])


def _of_nodes(tree: Tree, points_m: np.ndarray) -> np.ndarray:
    """Shape (frame, node, 3): where nodes are; a root that no keypoint shows is between two that mirror each other."""
    known = np.full((len(points_m), len(tree.nodes), 3), np.nan)
    has = tree.keypoint_nodes >= 0
    known[:, tree.keypoint_nodes[has]] = points_m[:, has]
    places = places_of(tree, tree.shape_m)
    own = [n for n in _riding(tree, 0) if n > 0] if tree.segments else []
    if len(own) == _FEWEST and np.allclose(places[own].mean(axis=0), 0.0):
        known[:, 0] = np.where(np.isfinite(known[:, 0]), known[:, 0], known[:, own].mean(axis=1))
    return known


def _riding(tree: Tree, segment: int) -> list[int]:
    """Nodes that a segment carries, from the point it turns about."""
    mine = [n for n, node in enumerate(tree.nodes) if node.parent >= 0 and not node.is_bone and node.mover == segment]
    return [n for n in mine if tree.nodes[n].parent == tree.nodes[mine[0]].parent]


def _turn(tree: Tree, segment: int, known: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Shape (frame, 3, 3): world from segment, NaN where too few points show it."""
    riding, places = _riding(tree, segment), places_of(tree, tree.shape_m)
    if not riding:
        return np.full((len(known), 3, 3), np.nan)
    at = tree.nodes[riding[0]].parent
    beside = [n for n, node in enumerate(tree.nodes) if node.parent == at and not node.is_bone and n not in riding]
    beside = beside if segment == 0 else []
    columns = [at, *riding, *beside]
    weights = np.isfinite(known[:, columns, 0]) * np.array(
        [1.0] * (1 + len(riding)) + [_NEIGHBOUR_WEIGHT] * len(beside)
    )
    there = np.nan_to_num(known[:, columns])
    here = np.stack([np.zeros(3), *places[riding], *places[beside]])
    share = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
    there = there - np.einsum("fn,fni->fi", share, there)[:, None]
    here = here - np.einsum("fn,ni->fi", share, here)[:, None]
    moments = np.einsum("fn,fni,fnj->fij", weights, there, here)
    if segment > 0:
        size = np.linalg.norm(moments, axis=(1, 2))[:, None, None]
        moments = moments + _CARRIER_SHARE * size * np.nan_to_num(turns[:, _carrier(tree, at)])
    enough = (np.isfinite(known[:, riding, 0]).sum(axis=1) >= _FEWEST) & ((weights > 0.0).sum(axis=1) > _FEWEST)
    return np.where(enough[:, None, None], _polar(moments), np.nan)


def _carrier(tree: Tree, node: int) -> int:
    """The segment that carries a node, through bones."""
    while tree.nodes[node].is_bone:
        node = tree.nodes[node].parent
    return max(tree.nodes[node].mover, 0)


def _polar(moments: np.ndarray) -> np.ndarray:
    """The rotations nearest to matrices, shape (frame, 3, 3)."""
    left, _, right = np.linalg.svd(moments)
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    return left @ right
