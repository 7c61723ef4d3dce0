"""Initial pose and uncertainty of a body from triangulated keypoints, from which the filter starts."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.tracking.records import State
from posefuse.model.options.tracker import MotionOptions
from posefuse.model.rotations import closest_rotation, rotations_from_vectors
from posefuse.skeleton.trees import Tree

_NEIGHBOR_WEIGHT = 0.1
_REST_WEIGHT = 1e-3
"""Weight of the rest pose, in m^2 for an adult human."""
# Standard deviations of an initial pose for an adult human.
_ROOT_SD_M, _TURN_SD, _LIMB_SD = 0.3, 0.7, 0.7
_MAX_ROOT_SD_M = 5.0


@dataclass(frozen=True, eq=False)
class _Structure:
    """What a pose from points takes from a tree, whatever the points.

    Attributes:
        root_nodes: The root, and the nodes on segments that hang on it.
        root_weights: shape (root node,): their weights.
        steps: By node, its parent, its mover, whether that is a bone, and the segment that carries the node.
        riding: By segment, parents first, the nodes that hang on its pivot.
        bone_nodes: Far ends of the bones, parents first.
        bone_ends: shape (bone, 2): far and near end of each bone.
    """

    root_nodes: np.ndarray
    root_weights: np.ndarray
    steps: tuple[tuple[int, int, bool, int], ...]
    riding: dict[int, list[int]]
    bone_nodes: tuple[int, ...]
    bone_ends: np.ndarray


@lru_cache(maxsize=16)
def _structure_of(tree: Tree) -> _Structure:
    nodes = tree.nodes
    root = [n for n, node in enumerate(nodes) if n == 0 or (node.parent == 0 and not node.is_bone)]
    weights = [1.0 if n == 0 or nodes[n].mover == 0 else _NEIGHBOR_WEIGHT for n in root]
    steps: list[tuple[int, int, bool, int]] = []
    riding: dict[int, list[int]] = {}
    for n, node in enumerate(nodes):
        carrier = steps[node.parent][3] if node.is_bone and node.parent >= 0 else 0 if node.parent < 0 else node.mover
        steps.append((node.parent, node.mover, node.is_bone, carrier))
        if node.parent >= 0 and not node.is_bone:
            # Points that hang on other points of the segment have no offset from its pivot.
            mine = riding.setdefault(node.mover, [])
            if not mine or nodes[mine[0]].parent == node.parent:
                mine.append(n)
    bone_nodes = tuple(n for n, node in enumerate(nodes) if node.is_bone)
    ends = np.zeros((len(tree.bones), 2), dtype=np.int64)
    for n in bone_nodes:
        ends[nodes[n].mover] = n, nodes[n].parent
    return _Structure(np.array(root), np.array(weights), tuple(steps), riding, bone_nodes, ends)


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
    structure, known, places = _structure_of(tree), _known_nodes(tree, points_m), node_offsets(tree, shape_m)
    is_known = [bool(each) for each in np.isfinite(known[:, 0])]
    turns = np.tile(np.eye(3), (len(tree.segments), 1, 1))
    bones = np.tile(np.eye(3), (len(tree.bones), 1, 1))
    found: dict[int, np.ndarray] = {}
    found[0], turns[:1] = _root(tree, structure, known, places)

    def place(n: int) -> np.ndarray:
        """Return where a node is by the turns and bones before it."""
        if n not in found:
            parent, mover, is_bone, _ = structure.steps[n]
            found[n] = place(parent) + (places[n, 2] * bones[mover, :, 2] if is_bone else turns[mover] @ places[n])
        return found[n]

    for segment, nodes in structure.riding.items():
        if segment:
            mine = [n for n in nodes if is_known[n]]
            pivot, _, _, _ = structure.steps[nodes[0]]
            origin = known[pivot] if is_known[pivot] else place(pivot)
            turns[segment] = _turn(tree, known[mine] - origin, places[mine], turns[structure.steps[pivot][3]])
    for n in structure.bone_nodes:
        parent, bone, _, carrier = structure.steps[n]
        direction = known[n] - (known[parent] if is_known[parent] else place(parent))
        if not (is_known[n] and direction.any()):
            direction = turns[carrier] @ tree.rest[bone] if tree.segments else tree.rest[bone]
        bones[bone] = _frame_along(*direction.tolist())
    return place(0), turns, bones


def _known_nodes(tree: Tree, points_m: np.ndarray) -> np.ndarray:
    """Return the points of the nodes, shape (node, 3), NaN where unknown."""
    known = np.full((len(tree.nodes), 3), np.nan)
    has = tree.keypoint_nodes >= 0
    known[tree.keypoint_nodes[has]] = points_m[has]
    return known


def node_offsets(tree: Tree, shape_m: np.ndarray) -> np.ndarray:
    """Return the offsets of nodes in the axes of their carriers, shape (node, 3)."""
    _, _, _, places, shape_of, signs, _, _ = tree.packed
    own = signs * np.append(shape_m, 0.0)[shape_of]
    return np.where(shape_of >= 0, own, places)


def _root(tree: Tree, structure: _Structure, known: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return position and turn of the root from all points on segments at the root."""
    is_seen = np.isfinite(known[structure.root_nodes, 0])
    seen, weights = structure.root_nodes[is_seen], structure.root_weights[is_seen]
    if not tree.segments or len(seen) < 2:
        there = known[0] if np.isfinite(known[0, 0]) else np.nanmedian(known, axis=0)
        return there, np.eye(3)
    share = weights / weights.sum()
    middle_of, middle = share @ places[seen], share @ known[seen]
    moments = ((known[seen] - middle).T * weights) @ (places[seen] - middle_of)
    turn = closest_rotation(moments + _REST_WEIGHT * tree.scale**2 * np.eye(3))
    return known[0] if np.isfinite(known[0, 0]) else middle - turn @ middle_of, turn


def _turn(tree: Tree, there: np.ndarray, here: np.ndarray, parent: np.ndarray) -> np.ndarray:
    """Return the turn of a segment by its points from its pivot, and close to that of the segment that carries it."""
    moments = there.T @ here
    return closest_rotation(moments + max(_REST_WEIGHT * tree.scale**2, 0.02 * np.linalg.norm(moments)) * parent)


def _frame_along(x: float, y: float, z: float) -> tuple[tuple[float, float, float], ...]:
    """Return a rotation whose third axis has a direction, row by row."""
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    # The first axis is closest to the axis of the world that is farthest from the direction.
    least = min(abs(x), abs(y), abs(z))
    a, b, c = (1.0, 0.0, 0.0) if abs(x) == least else (0.0, 1.0, 0.0) if abs(y) == least else (0.0, 0.0, 1.0)
    along = a * x + b * y + c * z
    a, b, c = a - x * along, b - y * along, c - z * along
    length = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / length, b / length, c / length
    return (a, y * c - z * b, x), (b, z * a - x * c, y), (c, x * b - y * a, z)


def bone_vectors(tree: Tree, points_m: np.ndarray) -> np.ndarray:
    """Return the vectors from end to end of bones, shape (bone, 3), NaN where a point is missing.

    Args:
        tree: Tree of the body.
        points_m: shape (keypoint, 3), NaN where unknown.
    """
    known = _known_nodes(tree, points_m)
    ends = _structure_of(tree).bone_ends
    return known[ends[:, 0]] - known[ends[:, 1]]


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
        turn = rotations_from_vectors(axis * np.arctan2(sine, float(old @ new)))
        frames[b] = turn @ frames[b]


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
    covariance = _pose_covariance(tree, motion).copy()
    covariance[n : n + h, n : n + h] = shape_covariance
    return covariance


@lru_cache(maxsize=16)
def _pose_covariance(tree: Tree, motion: MotionOptions) -> np.ndarray:
    """Return the covariance of an initial state whose lengths are certain, shape (all, all)."""
    n, h = tree.n_pose, tree.n_shape
    spread = np.repeat([_ROOT_SD_M * tree.scale, _TURN_SD, _LIMB_SD], [3, 3 * len(tree.segments), 2 * len(tree.bones)])
    covariance = np.zeros((2 * n + h, 2 * n + h))
    covariance[:n, :n] = np.diag(spread**2)
    decay, power = motion_parameters(tree, motion)
    covariance[n + h :, n + h :] = np.diag(0.5 * power * decay)
    return frozen(covariance)


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
