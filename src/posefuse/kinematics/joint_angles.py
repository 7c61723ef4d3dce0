"""Joint angles in degrees from turns of segments and directions of bones. See docs/methods/angles.md."""

from collections.abc import Callable, Iterator
from functools import lru_cache

import numpy as np

from posefuse.kinematics.twist import carrier, cross, full_rotations, least_rotation, near_node, rest_frames
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import Node, Tree

_DOWN = np.array([0.0, 0.0, -1.0])
_MIN_SAGITTAL = 0.1
"""Sine of the angle, about 6 degrees, within which a limb held sideways has no defined flexion."""


def joint_angles(
    tree: Tree, turns: np.ndarray, directions: np.ndarray, up: tuple[float, float, float] = (0.0, 0.0, 1.0)
) -> tuple[tuple[str, ...], np.ndarray]:
    """Return all angles that a body's segments and bones define.

    A segment's axes are forward, left and up. The root has, in the world and as successive rotations in this order,
    ``heading`` (to the left, about up; 0 where it faces along the first world axis that is perpendicular to ``up``),
    ``tilt`` (forward) and ``list`` (to the right). Other segments have, relative to their carriers and in this order,
    ``bend`` (forward), ``lean`` (to the right) and ``turn`` (to the left). Bones that hang down from a segment have
    ``flexion`` (forward), ``abduction`` (outward) and ``rotation`` (inward, about the bone, from the least rotation).
    Bones after bones have ``flexion``, the angle between them, 0 when straight; at a root that is no segment, the angle
    with the first bone. Other bones on a segment have ``bend``, the angle from their rest direction.

    Args:
        tree: Tree of the body.
        turns: shape (..., segment, 3, 3): world from segment; NaN where a person is not tracked.
        directions: shape (..., bone, 3): unit vectors; NaN where unknown.
        up: Up direction of the world.

    Returns:
        Names, ``joint.angle``, and angles, shape (..., angle), in degrees; NaN where they are unknown: missing people,
        unobserved rotations, and flexions of limbs held sideways.
    """
    frames, unseen = full_rotations(tree, turns, directions)
    found = [*_of_segments(tree, turns, frames, _world(up)), *_of_bones(tree, turns, directions, frames, unseen)]
    names = tuple(name for name, _ in found)
    if not found:
        return names, np.empty((*directions.shape[:-2], 0))
    return names, np.degrees(np.stack([angle for _, angle in found], axis=-1))


def skeleton_angles(
    skeleton: Skeleton, turns: np.ndarray, directions: np.ndarray, up: tuple[float, float, float] = (0.0, 0.0, 1.0)
) -> tuple[tuple[str, ...], np.ndarray]:
    """Return all angles of a skeleton's body and of its parts, segments and bones of the body first.

    A part's root is a segment relative to its carrier: the forearm of a hand, the head of a face.

    Args:
        skeleton: Skeleton with a tree.
        turns: shape (..., segment, 3, 3), as for :func:`joint_angles`.
        directions: shape (..., bone, 3).
        up: Up direction of the world.

    Returns:
        Names and angles, as those of :func:`joint_angles`.
    """
    body = skeleton.tree
    assert body is not None
    s, b = len(body.segments), len(body.bones)
    frames, _ = full_rotations(body, turns[..., :s, :, :], directions[..., :b, :])
    found = [joint_angles(body, turns[..., :s, :, :], directions[..., :b, :], up)]
    for part in skeleton.parts:
        n, m = len(part.tree.segments), len(part.tree.bones)
        mine, theirs = turns[..., s : s + n, :, :], directions[..., b : b + m, :]
        names, angles = joint_angles(part.tree, mine, theirs)
        at = body.nodes[body.keypoint_nodes[part.at]]
        own = axes_at(body, at, turns, frames)
        successive = relative_angles(own, mine[..., 0, :, :])
        root = tuple(f"{part.tree.segments[0]}.{name}" for name in ("bend", "lean", "turn"))
        # The first three angles are those of the part's root in the world.
        found.append(((*root, *names[3:]), np.concatenate([successive, angles[..., 3:]], axis=-1)))
        s, b = s + n, b + m
    return tuple(name for names, _ in found for name in names), np.concatenate([a for _, a in found], axis=-1)


@lru_cache(maxsize=64)
def angle_names(tree: Tree) -> tuple[str, ...]:
    """Return the names of the angles of :func:`joint_angles`."""
    return joint_angles(tree, np.empty((0, len(tree.segments), 3, 3)), np.empty((0, len(tree.bones), 3)))[0]


def skeleton_angle_names(skeleton: Skeleton) -> tuple[str, ...]:
    """Return the names of the angles of :func:`skeleton_angles`."""
    segments, bones, _ = skeleton.body_names
    return skeleton_angles(skeleton, np.empty((0, len(segments), 3, 3)), np.empty((0, len(bones), 3)))[0]


def _world(up: tuple[float, float, float]) -> np.ndarray:
    """Return world from the axes forward, left and up, shape (3, 3).

    Forward is the first world axis that is roughly perpendicular to up.
    """
    above = np.array(up) / np.linalg.norm(up)
    ahead = np.eye(3)[int(np.argmax(np.abs(above) < 0.9))]
    ahead = ahead - (ahead @ above) * above
    ahead /= np.linalg.norm(ahead)
    return np.stack([ahead, np.cross(above, ahead), above], axis=1)


def _of_segments(
    tree: Tree, turns: np.ndarray, frames: np.ndarray, world: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    for s, name in enumerate(tree.segments):
        turn = turns[..., s, :, :]
        if s == 0:
            heading, tilt, to_right = _successive(world.T @ turn)
            yield from ((f"{name}.heading", heading), (f"{name}.tilt", tilt), (f"{name}.list", to_right))
            continue
        bend, lean, about = _in_carrier(_own_axes(tree, s, turns, frames), turn)
        yield from ((f"{name}.bend", bend), (f"{name}.lean", lean), (f"{name}.turn", about))


def _successive(turn: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rotations about up, left and forward, in this order: Rz Ry Rx."""
    return (
        np.arctan2(turn[..., 1, 0], turn[..., 0, 0]),
        np.arcsin(np.clip(-turn[..., 2, 0], -1.0, 1.0)),
        np.arctan2(turn[..., 2, 1], turn[..., 2, 2]),
    )


def _in_carrier(own: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return bend, lean and turn of a segment relative to its carrier, in this order: Ry Rx Rz."""
    relative = np.swapaxes(own, -1, -2) @ turn
    return (
        np.arctan2(relative[..., 0, 2], relative[..., 2, 2]),
        np.arcsin(np.clip(-relative[..., 1, 2], -1.0, 1.0)),
        np.arctan2(relative[..., 1, 0], relative[..., 1, 1]),
    )


def root_angles(turn: np.ndarray, up: tuple[float, float, float]) -> np.ndarray:
    """Return heading, tilt and list of a root segment, shape (..., 3), in degrees.

    Args:
        turn: shape (..., 3, 3): world from segment.
        up: Up direction of the world.
    """
    return np.degrees(np.stack(_successive(_world(up).T @ turn), axis=-1))


def relative_angles(own: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return bend, lean and turn of a segment relative to its carrier, shape (..., 3), in degrees.

    Args:
        own: shape (..., 3, 3): axes of the carrier, from :func:`axes_at`.
        turn: shape (..., 3, 3): world from segment.
    """
    return np.degrees(np.stack(_in_carrier(own, turn), axis=-1))


def _own_axes(tree: Tree, segment: int, turns: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Return the axes of a segment's carrier, aligned with the body when it stands straight, shape (..., 3, 3)."""
    first = next(node for node in tree.nodes if not node.is_bone and node.mover == segment)
    return axes_at(tree, tree.nodes[first.parent], turns, frames)


def axes_at(tree: Tree, at: Node, turns: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Return the axes of a node's mover, aligned with the body when it stands straight, shape (..., 3, 3)."""
    if at.is_bone:
        return frames[..., at.mover, :, :] @ rest_frames(tree)[at.mover].T
    return turns[..., at.mover, :, :]


def _of_bones(
    tree: Tree, turns: np.ndarray, directions: np.ndarray, frames: np.ndarray, unseen: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    rest = rest_frames(tree)
    joint = _joint_namer(tree)
    for b, end in enumerate(tree.bones):
        before, segment = carrier(tree, b)
        along = directions[..., b, :]
        if before >= 0:
            yield f"{joint(b)}.flexion", _between(directions[..., before, :], along)
        elif segment < 0:
            first = next(bone for bone in range(b + 1) if carrier(tree, bone) == (-1, -1))
            if b != first:
                yield f"{joint(b)}.flexion", _between(-directions[..., first, :], along)
        else:
            local = np.einsum("...ji,...j->...i", turns[..., segment, :, :], along)
            if tree.rest[b] @ _DOWN < 0.99:
                yield f"{joint(b)}.bend", _between(np.broadcast_to(tree.rest[b], local.shape), local)
                continue
            side = -1.0 if end.startswith("right_") else 1.0
            across = np.hypot(local[..., 0], local[..., 2])
            flexion = np.where(across > _MIN_SAGITTAL, np.arctan2(local[..., 0], -local[..., 2]), np.nan)
            yield f"{joint(b)}.flexion", flexion
            yield f"{joint(b)}.abduction", side * np.arctan2(local[..., 1], across)
            least = least_rotation(tree, b, turns, directions, frames, rest)
            relative = np.swapaxes(least, -1, -2) @ frames[..., b, :, :]
            twist = np.arctan2(relative[..., 1, 0], relative[..., 0, 0])
            yield f"{joint(b)}.rotation", np.where(unseen[..., b], np.nan, side * twist)


def _between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the angle between vectors, shape (...,), in radians."""
    return np.arctan2(np.linalg.norm(cross(first, second), axis=-1), np.einsum("...i,...i->...", first, second))


def _joint_namer(tree: Tree) -> Callable[[int], str]:
    """Return a function that names joints: the start of a bone, with its end if several bones start there."""
    near = [near_node(tree, b) for b in range(len(tree.bones))]

    def name(bone: int) -> str:
        here = tree.nodes[near[bone]].name
        return here if near.count(near[bone]) == 1 else f"{here}-{tree.bones[bone]}"

    return name
