"""Twist of limbs, which keypoints do not show directly, from the plane in which the next bone bends.

See docs/methods/angles.md.
"""

from functools import lru_cache

import numpy as np

from posefuse.arrays import frozen, kernel_array
from posefuse.kernels.kinematics.twist import BoneTable, twist_bones
from posefuse.skeleton.trees import HINGE, Tree

_STRAIGHT, _BENT = np.radians(5.0), np.radians(15.0)
_MIN_HINGE_COSINE = 0.7
"""Cosine between a hinge's axis and the axis of the bend from which the hinge defines the sense."""
_LEFT = np.array([0.0, 1.0, 0.0])
_UP = np.array([0.0, 0.0, 1.0])
# Elbows bend forward and knees backward; for other joints the hinges of the tree define the sense.
_BENDS_BACKWARD = {"left_wrist": False, "right_wrist": False, "left_ankle": True, "right_ankle": True}


def full_rotations(tree: Tree, turns: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations of bones with a twist: world from bone.

    The third axis points along the bone. The second is the axis about which the next bone bends (for the last bone of a
    chain, the bone before it), to the person's left when standing straight. Below a bend of 5 degrees, the twist is
    that of the least rotation from rest relative to the carrier; above 15 degrees, the plane of the bend defines it;
    between them, the twist is interpolated.

    Args:
        tree: Tree of the body.
        turns: shape (..., segment, 3, 3): world from segment.
        directions: shape (..., bone, 3): unit vectors, NaN where unknown.

    Returns:
        Rotations, shape (..., bone, 3, 3), and whether the twist is unobserved, shape (..., bone), bool.
    """
    n_bones, before = len(tree.bones), directions.shape[:-2]
    poses = int(np.prod(before))
    along = kernel_array(directions).reshape(poses, n_bones, 3)
    of_segments = kernel_array(np.broadcast_to(turns, (*before, *turns.shape[-3:]))).reshape(poses, *turns.shape[-3:])
    frames, unseen = np.empty((poses, n_bones, 3, 3)), np.empty((poses, n_bones), dtype=np.bool_)
    twist_bones(_bone_table(tree), of_segments, along, _STRAIGHT, _BENT, frames, unseen)
    return frames.reshape(*before, n_bones, 3, 3), unseen.reshape(*before, n_bones)


@lru_cache(maxsize=64)
def _bone_table(tree: Tree) -> BoneTable:
    """Return the bones of a tree in the order of the kernel."""
    frames, rows, rest = rest_frames(tree), [], []
    for bone in bones_in_order(tree):
        before, segment = carrier(tree, bone)
        first, then = _bending_pair(tree, bone)
        rows.append((bone, before, segment, first, then, _sense(tree, bone, then) if first >= 0 else 0))
        rest.append(frames[before].T @ frames[bone] if before >= 0 else frames[bone])
    return BoneTable(np.array(rows, dtype=np.int64).reshape(-1, 6), np.array(rest).reshape(-1, 3, 3))


@lru_cache(maxsize=64)
def rest_frames(tree: Tree) -> np.ndarray:
    """Return the frames of bones at rest, shape (bone, 3, 3): third axis along the bone, second to the left."""
    frames = np.empty((len(tree.bones), 3, 3))
    for b, along in enumerate(tree.rest):
        aside = _LEFT if abs(along @ _LEFT) < 0.9 else _UP
        second = aside - (aside @ along) * along
        second /= np.linalg.norm(second)
        frames[b] = np.stack([np.cross(second, along), second, along], axis=1)
    return frozen(frames)


def cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return cross products, shape (..., 3); several times as fast as ``np.cross`` for few vectors."""
    a, b, c = first[..., 0], first[..., 1], first[..., 2]
    x, y, z = second[..., 0], second[..., 1], second[..., 2]
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-1)


def carrier(tree: Tree, bone: int) -> tuple[int, int]:
    """Return the carrier of a bone: indices of a bone and of a segment, -1 for the other or for none."""
    near = tree.nodes[near_node(tree, bone)]
    if near.is_bone:
        return near.mover, -1
    return -1, near.mover if tree.segments else -1


def near_node(tree: Tree, bone: int) -> int:
    """Return the index of the node at which a bone starts."""
    return next(node.parent for node in tree.nodes if node.is_bone and node.mover == bone)


def least_rotation(
    tree: Tree, bone: int, turns: np.ndarray, directions: np.ndarray, frames: np.ndarray, rest: np.ndarray
) -> np.ndarray:
    """Return a bone's rotation by the least rotation from its rest direction, shape (..., 3, 3).

    Args:
        tree: Tree of the body.
        bone: Index of the bone.
        turns: shape (..., segment, 3, 3).
        directions: shape (..., bone, 3).
        frames: shape (..., bone, 3, 3): frames of the bones that carry others.
        rest: shape (bone, 3, 3), from :func:`rest_frames`.
    """
    before, segment = carrier(tree, bone)
    if before >= 0:
        standing = frames[..., before, :, :] @ (rest[before].T @ rest[bone])
    elif segment >= 0:
        standing = turns[..., segment, :, :] @ rest[bone]
    else:
        standing = np.broadcast_to(rest[bone], (*directions.shape[:-2], 3, 3))
    return _least_turn(standing[..., 2], directions[..., bone, :]) @ standing


def _least_turn(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the least rotation between unit vectors, shape (..., 3, 3); some half turn if they are opposite."""
    cosine = np.einsum("...i,...i->...", start, end)
    normal = cross(start, end)
    x, y, z = normal[..., 0], normal[..., 1], normal[..., 2]
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    opposite = cosine < -1.0 + 1e-9
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.eye(3) + skew + skew @ skew / (1.0 + cosine)[..., None, None]
    if opposite.any():
        turn[opposite] = _half_turn(np.broadcast_to(start, end.shape)[opposite])
    return turn


def _half_turn(start: np.ndarray) -> np.ndarray:
    """Return a half turn about a perpendicular unit vector, shape (..., 3, 3)."""
    across = np.cross(start, np.eye(3)[np.argmin(np.abs(start), axis=-1)])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    return 2.0 * across[..., :, None] * across[..., None, :] - np.eye(3)


def about_third_axis(angle: np.ndarray) -> np.ndarray:
    """Return rotations about the third axis by angles in radians, shape (..., 3, 3)."""
    c, s, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    return np.stack([c, -s, zero, s, c, zero, zero, zero, zero + 1.0], axis=-1).reshape(*angle.shape, 3, 3)


def bending_axis(tree: Tree, bone: int, directions: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the axis about which a bone bends with its neighbor, shape (..., 3), and the angle, shape (...,), radians.

    If the sense in which the joint bends is unknown, the axis is the one closer to ``second``.
    """
    first, then = _bending_pair(tree, bone)
    if first < 0:
        return second, np.zeros(second.shape[:-1])
    normal = cross(directions[..., first, :], directions[..., then, :])
    size = np.linalg.norm(normal, axis=-1)
    bend = np.arctan2(size, np.einsum("...i,...i->...", directions[..., first, :], directions[..., then, :]))
    axis = normal / np.maximum(size, 1e-12)[..., None]
    sense = _sense(tree, bone, then)
    if sense:
        return sense * axis, bend
    nearer = np.einsum("...i,...i->...", axis, second) >= 0.0
    return np.where(nearer[..., None], axis, -axis), bend


@lru_cache(maxsize=1024)
def _sense(tree: Tree, bone: int, then: int) -> int:
    """Return the sense in which a joint bends about the second axis of a bone, 1 or -1; 0 if it is unknown.

    The names of elbows and knees define it, and the hinges of the tree.
    """
    if tree.bones[then] in _BENDS_BACKWARD:
        return 1 if _BENDS_BACKWARD[tree.bones[then]] else -1
    for limit in tree.limits:
        if limit.kind == HINGE and limit.bone == then:
            along = float(np.dot(limit.axis, rest_frames(tree)[bone][:, 1]))
            return int(np.sign(along)) if abs(along) > _MIN_HINGE_COSINE else 0
    return 0


def _bending_pair(tree: Tree, bone: int) -> tuple[int, int]:
    """Return the two successive bones whose plane defines the twist of a bone; -1 if there are none."""
    following = [b for b in range(len(tree.bones)) if carrier(tree, b)[0] == bone]
    if following:
        return bone, following[0]
    before = carrier(tree, bone)[0]
    return (before, bone) if before >= 0 else (-1, -1)


def bones_in_order(tree: Tree) -> list[int]:
    """Return the bones in an order in which carriers come first."""
    return [node.mover for node in tree.nodes if node.is_bone]
