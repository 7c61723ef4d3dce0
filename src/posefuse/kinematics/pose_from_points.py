"""Poses of bodies from their points alone, without a fitted model."""

import numpy as np

from posefuse.kinematics.initial_pose import node_offsets
from posefuse.model.rotations import closest_rotation
from posefuse.skeleton.trees import Tree

_MIN_POINTS = 2
_NEIGHBOR_WEIGHT = 0.1
_CARRIER_SHARE = 1e-3
"""Weight of the carrier's turn relative to a segment's points: it only decides what these leave undetermined."""


def pose_of_points(tree: Tree, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return turns of segments and directions of bones from points.

    A segment's turn is the least-squares fit of its points and its pivot to those of an average body (Kabsch 1976);
    that of the root also uses the points of segments at the root. A bone points from one end to the other.

    Args:
        tree: Tree of the body.
        points_m: shape (..., keypoint, 3), NaN where unknown.

    Returns:
        Turns, shape (..., segment, 3, 3), NaN where fewer than two points show a segment; and directions, shape
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
    """Return the positions of nodes, shape (frame, node, 3); a root without keypoint is between its mirrored nodes."""
    known = np.full((len(points_m), len(tree.nodes), 3), np.nan)
    has = tree.keypoint_nodes >= 0
    known[:, tree.keypoint_nodes[has]] = points_m[:, has]
    places = node_offsets(tree, tree.shape_m)
    own = [n for n in _riding(tree, 0) if n > 0] if tree.segments else []
    if len(own) == _MIN_POINTS and np.allclose(places[own].mean(axis=0), 0.0):
        known[:, 0] = np.where(np.isfinite(known[:, 0]), known[:, 0], known[:, own].mean(axis=1))
    return known


def _riding(tree: Tree, segment: int) -> list[int]:
    """Return the nodes that a segment carries from its pivot."""
    mine = [n for n, node in enumerate(tree.nodes) if node.parent >= 0 and not node.is_bone and node.mover == segment]
    return [n for n in mine if tree.nodes[n].parent == tree.nodes[mine[0]].parent]


def _turn(tree: Tree, segment: int, known: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return world from segment, shape (frame, 3, 3), NaN where too few points show the segment."""
    riding, places = _riding(tree, segment), node_offsets(tree, tree.shape_m)
    if not riding:
        return np.full((len(known), 3, 3), np.nan)
    at = tree.nodes[riding[0]].parent
    beside = [n for n, node in enumerate(tree.nodes) if node.parent == at and not node.is_bone and n not in riding]
    beside = beside if segment == 0 else []
    columns = [at, *riding, *beside]
    weights = np.isfinite(known[:, columns, 0]) * np.array([1.0] * (1 + len(riding)) + [_NEIGHBOR_WEIGHT] * len(beside))
    there = np.nan_to_num(known[:, columns])
    here = np.stack([np.zeros(3), *places[riding], *places[beside]])
    share = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
    there = there - np.einsum("fn,fni->fi", share, there)[:, None]
    here = here - np.einsum("fn,ni->fi", share, here)[:, None]
    moments = np.einsum("fn,fni,fnj->fij", weights, there, here)
    if segment > 0:
        size = np.linalg.norm(moments, axis=(1, 2))[:, None, None]
        moments = moments + _CARRIER_SHARE * size * np.nan_to_num(turns[:, _carrier(tree, at)])
    enough = (np.isfinite(known[:, riding, 0]).sum(axis=1) >= _MIN_POINTS) & ((weights > 0.0).sum(axis=1) > _MIN_POINTS)
    return np.where(enough[:, None, None], closest_rotation(moments), np.nan)


def _carrier(tree: Tree, node: int) -> int:
    """Return the segment that carries a node, possibly through bones."""
    while tree.nodes[node].is_bone:
        node = tree.nodes[node].parent
    return max(tree.nodes[node].mover, 0)
