"""Initial pose and uncertainty of a body from triangulated keypoints, from which the filter starts."""

from collections.abc import Iterable

import numpy as np
from scipy.spatial.transform import Rotation

from posefuse.kernels.tracking.records import State
from posefuse.model.options.tracker import MotionOptions
from posefuse.model.rotations import closest_rotation
from posefuse.skeleton.trees import Tree

_NEIGHBOR_WEIGHT = 0.1
_REST_WEIGHT = 1e-3
"""Weight of the rest pose, in m^2 for an adult human."""
# Standard deviations of an initial pose for an adult human.
_ROOT_SD_M, _TURN_SD, _LIMB_SD = 0.3, 0.7, 0.7
_MAX_ROOT_SD_M = 5.0


def pose_from_points(
    tree: Tree, points_m: np.ndarray, shape_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit a pose to points: segments by least squares (Kabsch 1976), bones by their ends.

    Args:
        tree: Tree of the body.
        points_m: shape (keypoint, 3), NaN where unknown.
        shape_m: shape (shape,).

    Returns:
        Root, shape (3,), turns of segments (segment, 3, 3) and frames of bones (bone, 3, 3).
    """
    known = np.full((len(tree.nodes), 3), np.nan)
    has = tree.keypoint_nodes >= 0
    known[tree.keypoint_nodes[has]] = points_m[has]
    places = node_offsets(tree, shape_m)
    turns = np.tile(np.eye(3), (len(tree.segments), 1, 1))
    bones = np.tile(np.eye(3), (len(tree.bones), 1, 1))
    found = np.full_like(known, np.nan)
    found[0], turns[:1] = _root(tree, known, places)
    holder = np.zeros(len(tree.nodes), dtype=int)
    turned = {0}
    for n, node in enumerate(tree.nodes):
        if node.parent < 0:
            continue
        holder[n] = holder[node.parent] if node.is_bone else node.mover
        start = found[node.parent]
        if node.is_bone:
            rest = turns[holder[n]] @ tree.rest[node.mover] if tree.segments else tree.rest[node.mover]
            near = known[node.parent] if np.isfinite(known[node.parent, 0]) else start
            direction = known[n] - near if np.isfinite(known[n] + near).all() else rest
            length = float(np.linalg.norm(direction))
            bones[node.mover] = _frame_along(direction / length if length > 1e-9 else rest)
            found[n] = start + places[n, 2] * bones[node.mover][:, 2]
        else:
            if node.mover not in turned:
                turned.add(node.mover)
                turns[node.mover] = _turn(tree, node.mover, known, places, start, turns[holder[node.parent]])
            found[n] = start + turns[node.mover] @ places[n]
    return found[0], turns, bones


def node_offsets(tree: Tree, shape_m: np.ndarray) -> np.ndarray:
    """Return the offsets of nodes in the axes of their carriers, shape (node, 3)."""
    _, _, _, places, shape_of, signs, _, _ = tree.packed
    own = signs * np.append(shape_m, 0.0)[shape_of]
    return np.where(shape_of >= 0, own, places)


def _root(tree: Tree, known: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return position and turn of the root from all points on segments at the root."""
    seen = [
        n
        for n, node in enumerate(tree.nodes)
        if np.isfinite(known[n, 0]) and (n == 0 or (node.parent == 0 and not node.is_bone))
    ]
    if not tree.segments or len(seen) < 2:
        there = known[0] if np.isfinite(known[0, 0]) else np.nanmedian(known, axis=0)
        return there, np.eye(3)
    own = np.array([n == 0 or tree.nodes[n].mover == 0 for n in seen])
    weights = np.where(own, 1.0, _NEIGHBOR_WEIGHT)
    middle_of, middle = (np.average(each[seen], axis=0, weights=weights) for each in (places, known))
    turn = closest_rotation(
        _moments(known[seen] - middle, places[seen] - middle_of, weights) + _REST_WEIGHT * tree.scale**2 * np.eye(3)
    )
    return known[0] if np.isfinite(known[0, 0]) else middle - turn @ middle_of, turn


def _turn(
    tree: Tree, segment: int, known: np.ndarray, places: np.ndarray, origin: np.ndarray, parent: np.ndarray
) -> np.ndarray:
    riding = [n for n, node in enumerate(tree.nodes) if node.parent >= 0 and not node.is_bone and node.mover == segment]
    # Points that hang on other points of the segment have no offset from its pivot.
    mine = [n for n in riding if tree.nodes[n].parent == tree.nodes[riding[0]].parent and np.isfinite(known[n, 0])]
    start = known[tree.nodes[mine[0]].parent] if mine else origin
    start = start if np.isfinite(start[0]) else origin
    moments = _moments(known[mine] - start, places[mine], np.ones(len(mine))) if mine else np.zeros((3, 3))
    return closest_rotation(moments + max(_REST_WEIGHT * tree.scale**2, 0.02 * np.linalg.norm(moments)) * parent)


def _moments(there: np.ndarray, here: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return np.einsum("n,ni,nj->ij", weights, there, here)


def _frame_along(direction: np.ndarray) -> np.ndarray:
    across = np.eye(3)[np.argmin(np.abs(direction))]
    first = across - direction * (direction @ across)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first), direction], axis=1)


def bone_vectors(tree: Tree, points_m: np.ndarray) -> np.ndarray:
    """Return the vectors from end to end of bones, shape (bone, 3), NaN where a point is missing.

    Args:
        tree: Tree of the body.
        points_m: shape (keypoint, 3), NaN where unknown.
    """
    known = np.full((len(tree.nodes), 3), np.nan)
    has = tree.keypoint_nodes >= 0
    known[tree.keypoint_nodes[has]] = points_m[has]
    shown = np.full((len(tree.bones), 3), np.nan)
    for n, node in enumerate(tree.nodes):
        if node.is_bone:
            shown[node.mover] = known[n] - known[node.parent]
    return shown


def turn_bones(frames: np.ndarray, shown: np.ndarray, bones: Iterable[int]) -> None:
    """Turn bones by the least rotation to observed directions; bones without one stay.

    Gauss-Newton steps do not find a direction that is far off.

    Args:
        frames: shape (bone, 3, 3), updated in place.
        shown: shape (bone, 3), from :func:`bone_vectors`.
        bones: Indices of the bones.
    """
    for b in bones:
        length = float(np.linalg.norm(shown[b]))
        if not length > 1e-9:
            continue
        old, new = frames[b][:, 2], shown[b] / length
        across = np.cross(old, new)
        sine = float(np.linalg.norm(across))
        axis = across / sine if sine > 1e-9 else frames[b][:, 0]
        turn = Rotation.from_rotvec(axis * np.arctan2(sine, float(old @ new)))
        frames[b] = turn.as_matrix() @ frames[b]


def initial_state(
    tree: Tree, points_m: np.ndarray, shape_m: np.ndarray, shape_covariance: np.ndarray, motion: MotionOptions
) -> State:
    """Return the initial state of one person close to observed points.

    Args:
        tree: Tree of the body.
        points_m: shape (keypoint, 3), NaN where unknown.
        shape_m: shape (shape,): initial bone lengths.
        shape_covariance: shape (shape, shape).
        motion: Motion model.
    """
    root, turns, bones = pose_from_points(tree, points_m, shape_m)
    covariance = initial_covariance(tree, shape_covariance, motion)
    return State(
        root[None].copy(),
        turns[None].copy(),
        bones[None].copy(),
        np.array(shape_m)[None].copy(),
        np.zeros((1, tree.n_pose)),
        covariance[None].copy(),
        np.ones(1, dtype=np.int64),
    )


def initial_covariance(tree: Tree, shape_covariance: np.ndarray, motion: MotionOptions) -> np.ndarray:
    """Return the covariance of an initial state, shape (all, all)."""
    n, h = tree.n_pose, tree.n_shape
    spread = np.concatenate(
        [
            np.full(3, _ROOT_SD_M * tree.scale),
            np.full(3 * len(tree.segments), _TURN_SD),
            np.full(2 * len(tree.bones), _LIMB_SD),
        ]
    )
    covariance = np.zeros((2 * n + h, 2 * n + h))
    covariance[:n, :n] = np.diag(spread**2)
    covariance[n : n + h, n : n + h] = shape_covariance
    decay, power = motion_parameters(tree, motion)
    covariance[n + h :, n + h :] = np.diag(0.5 * power * decay)
    return covariance


def motion_parameters(tree: Tree, motion: MotionOptions) -> tuple[np.ndarray, np.ndarray]:
    """Return the decay time of velocities and the spectral density of accelerations, shape (pose,) each."""
    kinds = [3, 3 * len(tree.segments), 2 * len(tree.bones)]
    decay = np.repeat([motion.root_decay_s, motion.turn_decay_s, motion.limb_decay_s], kinds)
    power = np.repeat([motion.root_acceleration, motion.turn_acceleration, motion.limb_acceleration], kinds)
    return decay, power


def max_variances(tree: Tree) -> np.ndarray:
    """Return the largest variances of the pose, shape (pose,); beyond them a direction is unknown."""
    return np.concatenate(
        [
            np.full(3, (_MAX_ROOT_SD_M * tree.scale) ** 2),
            np.full(3 * len(tree.segments), 0.6),
            np.full(2 * len(tree.bones), 0.8),
        ]
    )
