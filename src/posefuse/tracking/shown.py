"""How bodies stand by their points alone, where none was fitted to them."""

import numpy as np

from posefuse.model.trees import Tree
from posefuse.tracking.posing import bones_shown, pose_from_points

_FEWEST = 2


def shown_pose(tree: Tree, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turns of segments and directions of bones that points show.

    A segment is turned as its points lie (least squares to where they are in an average body; the root by what rides
    beside it too), a bone points from one end to the other.

    Args:
        tree: of the body.
        points_m: shape (..., keypoint, 3), NaN where unknown.

    Returns:
        Turns, shape (..., segment, 3, 3), NaN where fewer than two points show a segment, and directions, shape
        (..., bone, 3), NaN where an end is unknown.
    """
    flat = points_m.reshape(-1, *points_m.shape[-2:])
    turns = np.full((len(flat), len(tree.segments), 3, 3), np.nan)
    directions = np.full((len(flat), len(tree.bones), 3), np.nan)
    enough = _segments_shown(tree, flat)
    for f, points in enumerate(flat):
        if not np.isfinite(points[:, 0]).any():
            continue
        turns[f] = np.where(enough[f, :, None, None], _turns(tree, points), np.nan)
        along = bones_shown(tree, points)
        length = np.linalg.norm(along, axis=-1, keepdims=True)
        directions[f] = along / np.where(length > 0.0, length, np.nan)
    shape = points_m.shape[:-2]
    return turns.reshape(*shape, *turns.shape[1:]), directions.reshape(*shape, *directions.shape[1:])


def _turns(tree: Tree, points_m: np.ndarray) -> np.ndarray:
    """Shape (segment, 3, 3)."""
    if not tree.segments:
        return np.empty((0, 3, 3))
    # A first pose is drawn a little to the world's axes; seen from itself it is not.
    first = pose_from_points(tree, points_m, tree.shape_m)[1][0]
    return first @ pose_from_points(tree, points_m @ first, tree.shape_m)[1]


def _segments_shown(tree: Tree, points_m: np.ndarray) -> np.ndarray:
    """Shape (frame, segment), bool: whether enough points show how a segment is turned."""
    known = np.isfinite(points_m[..., 0])
    counts = np.zeros((len(points_m), len(tree.segments)), dtype=int)
    for keypoint, n in enumerate(tree.keypoint_nodes):
        node = tree.nodes[n] if n >= 0 else None
        if node is not None and not node.is_bone and node.parent >= 0:
            counts[:, node.mover] += known[:, keypoint]
    return counts >= _FEWEST
