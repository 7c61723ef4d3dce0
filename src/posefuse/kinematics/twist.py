"""How limbs are turned about themselves, which keypoints do not show: told by the plane in which the next bone bends.

See docs/methods/angles.md.
"""

from functools import lru_cache

import numpy as np

from posefuse.arrays import frozen
from posefuse.skeleton.trees import HINGE, Tree

_STRAIGHT, _BENT = np.radians(5.0), np.radians(15.0)
_ALONG = 0.7
"""A hinge's axis is that of the bend if its cosine with it is at least this."""
_LEFT = np.array([0.0, 1.0, 0.0])
_UP = np.array([0.0, 0.0, 1.0])
# Elbows bend forwards, knees backwards; of others hinges say it.
_BACKWARDS = {"left_wrist": False, "right_wrist": False, "left_ankle": True, "right_ankle": True}


def full_rotations(tree: Tree, turns: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations of bones with a twist: world from bone.

    The third axis points along the bone. The second is the axis about which the next bone bends (the last of a chain
    bends against the one before it), to the person's left when standing straight. A bone that bends by less than 5
    degrees has come from its rest by the least rotation in the axes of what carries it, one that bends by more than 15
    is as the plane says, and between them the one goes over into the other.

    Args:
        tree: of the body.
        turns: shape (..., segment, 3, 3): world from segment.
        directions: shape (..., bone, 3): unit vectors, NaN where unknown.

    Returns:
        The rotations, shape (..., bone, 3, 3), and whether the twist is not observed, shape (..., bone), bool.
    """
    rest = rest_frames(tree)
    out = np.empty((*directions.shape, 3))
    unseen = np.ones(directions.shape[:-1], dtype=bool)
    for bone in in_order(tree):
        least = least_rotation(tree, bone, turns, directions, out, rest)
        axis, bend = bending_axis(tree, bone, directions, least[..., 1])
        share = np.clip((bend - _STRAIGHT) / (_BENT - _STRAIGHT), 0.0, 1.0)
        twist = np.arctan2(
            -np.einsum("...i,...i->...", axis, least[..., 0]), np.einsum("...i,...i->...", axis, least[..., 1])
        )
        out[..., bone, :, :] = least @ about_third_axis(share * twist)
        unseen[..., bone] = ~(share >= 1.0)
    return out, unseen


@lru_cache(maxsize=64)
def rest_frames(tree: Tree) -> np.ndarray:
    """Shape (bone, 3, 3): of bones when standing: the third axis along the bone, the second to the left."""
    frames = np.empty((len(tree.bones), 3, 3))
    for b, along in enumerate(tree.rest):
        aside = _LEFT if abs(along @ _LEFT) < 0.9 else _UP
        second = aside - (aside @ along) * along
        second /= np.linalg.norm(second)
        frames[b] = np.stack([np.cross(second, along), second, along], axis=1)
    return frozen(frames)


def cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Cross products, shape (..., 3): ``np.cross`` several times as fast where there are few of them."""
    a, b, c = first[..., 0], first[..., 1], first[..., 2]
    x, y, z = second[..., 0], second[..., 1], second[..., 2]
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-1)


def carrier(tree: Tree, bone: int) -> tuple[int, int]:
    """What a bone hangs on: the number of a bone or of a segment, -1 for the other or for none."""
    near = tree.nodes[near_node(tree, bone)]
    if near.is_bone:
        return near.mover, -1
    return -1, near.mover if tree.segments else -1


def near_node(tree: Tree, bone: int) -> int:
    """The number of the node at which a bone begins."""
    return next(node.parent for node in tree.nodes if node.is_bone and node.mover == bone)


def least_rotation(
    tree: Tree, bone: int, turns: np.ndarray, directions: np.ndarray, frames: np.ndarray, rest: np.ndarray
) -> np.ndarray:
    """A bone's rotation had it come from its rest by the least rotation, shape (..., 3, 3).

    Args:
        tree: of the body.
        bone: its number.
        turns: shape (..., segment, 3, 3).
        directions: shape (..., bone, 3).
        frames: shape (..., bone, 3, 3): of the bone that carries this one, if one does.
        rest: shape (bone, 3, 3).
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
    """Shape (..., 3, 3): the least rotation from one unit vector to another; some half turn if it is the opposite."""
    cosine = np.einsum("...i,...i->...", start, end)
    normal = cross(start, end)
    x, y, z = normal[..., 0], normal[..., 1], normal[..., 2]
    nought = np.zeros_like(x)
    skew = np.stack([nought, -z, y, z, nought, -x, -y, x, nought], axis=-1).reshape(*x.shape, 3, 3)
    opposite = cosine < -1.0 + 1e-9
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.eye(3) + skew + skew @ skew / (1.0 + cosine)[..., None, None]
    if opposite.any():
        turn[opposite] = _half_turn(np.broadcast_to(start, end.shape)[opposite])
    return turn


def _half_turn(start: np.ndarray) -> np.ndarray:
    """Shape (..., 3, 3): a half turn about any unit vector across."""
    across = np.cross(start, np.eye(3)[np.argmin(np.abs(start), axis=-1)])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    return 2.0 * across[..., :, None] * across[..., None, :] - np.eye(3)


def about_third_axis(angle: np.ndarray) -> np.ndarray:
    """Shape (..., 3, 3): rotations about the third axis, radians."""
    c, s, nought = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    return np.stack([c, -s, nought, s, c, nought, nought, nought, nought + 1.0], axis=-1).reshape(*angle.shape, 3, 3)


def bending_axis(tree: Tree, bone: int, directions: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The axis about which a bone bends with its neighbour, shape (..., 3), and by how much, shape (...,), radians.

    Where nothing is known of the sense in which the joint bends, it is that nearer to ``second``.
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
    """Whether a joint bends about the second axis of a bone (1) or against it (-1); 0 where that is not known.

    Hinges of the tree say it, and of elbows and knees it is known.
    """
    if tree.bones[then] in _BACKWARDS:
        return 1 if _BACKWARDS[tree.bones[then]] else -1
    for limit in tree.limits:
        if limit.kind == HINGE and limit.bone == then:
            along = float(np.dot(limit.axis, rest_frames(tree)[bone][:, 1]))
            return int(np.sign(along)) if abs(along) > _ALONG else 0
    return 0


def _bending_pair(tree: Tree, bone: int) -> tuple[int, int]:
    """Two successive bones of which one is this, the plane of which tells its twist; -1 where there are none."""
    following = [b for b in range(len(tree.bones)) if carrier(tree, b)[0] == bone]
    if following:
        return bone, following[0]
    before = carrier(tree, bone)[0]
    return (before, bone) if before >= 0 else (-1, -1)


def in_order(tree: Tree) -> list[int]:
    """Bones, those that carry others before them."""
    return [node.mover for node in tree.nodes if node.is_bone]
