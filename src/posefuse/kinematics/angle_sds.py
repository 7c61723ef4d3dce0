"""How well joint angles are known, to first order, from the covariance of a pose. See docs/methods/angles.md.

The derivative of angles by the numbers of the pose is taken by finite differences, of many numbers at once where no
angle depends on two of them (Curtis, Powell & Reid 1974).
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from posefuse.arrays import ranges
from posefuse.kinematics.joint_angles import axes_at, carried_angles, joint_angles
from posefuse.kinematics.twist import full_rotations
from posefuse.skeleton.trees import Tree

_CHUNK = 512
"""Frames worked on at a time."""
_STEP = 1e-6
_PROBES = 8
_SOME = 1e-3
_UNKNOWN_DEG = 180.0 / np.sqrt(3.0)
"""Of an angle that may be anything; where the first order says more, it has no meaning."""

Read = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""From turns (..., segment, 3, 3) and frames of bones (..., bone, 3, 3) to readings (..., reading), degrees."""


def joint_angle_sds(
    tree: Tree,
    turns: np.ndarray,
    bones: np.ndarray,
    covariance: np.ndarray,
    up: tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> np.ndarray:
    """Standard deviations of the angles of :func:`posefuse.kinematics.joint_angles.joint_angles`.

    Args:
        tree: of the body.
        turns: shape (frame, segment, 3, 3): world from segment.
        bones: shape (frame, bone, 3, 3): the third axis is the bone's direction; errors are about the first two.
        covariance: shape (frame, pose, pose): of the numbers of the pose, in the tree's order.
        up: of the world.

    Returns:
        Shape (frame, angle), degrees; NaN where the angle is, at most what an angle has that may be anything.
    """
    groups, depends = _groups(tree, None)
    read, sds = _reader_of_angles(tree, up), np.empty((len(turns), len(depends)))
    for start, stop in ranges(len(turns), _CHUNK):
        to = slice(start, stop)
        derivative = _derivative(read, turns[to], bones[to], groups) * depends
        sds[to] = np.minimum(np.sqrt(_variances(derivative, covariance[to])), _UNKNOWN_DEG)
    return sds


def axes_covariance(tree: Tree, at: int, turns: np.ndarray, bones: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """How well the axes of what moves a node are known, twist included.

    Args:
        tree: of the body.
        at: number of the node.
        turns: shape (frame, segment, 3, 3).
        bones: shape (frame, bone, 3, 3).
        covariance: shape (frame, pose, pose).

    Returns:
        Shape (frame, 3, 3): of a small turn about these axes, degrees^2; NaN where the twist is not observed.
    """
    groups, depends = _groups(tree, at)
    out = np.empty((len(turns), 3, 3))
    for start, stop in ranges(len(turns), _CHUNK):
        to = slice(start, stop)
        read = _reader_of_axes(tree, at, turns[to], bones[to])
        derivative = _derivative(read, turns[to], bones[to], groups) * depends
        out[to] = derivative @ covariance[to, 3:, 3:] @ derivative.transpose(0, 2, 1)
    return out


def carried_angle_sds(
    own: np.ndarray, own_deg2: np.ndarray, turn: np.ndarray, turn_covariance: np.ndarray
) -> np.ndarray:
    """Standard deviations of bend, lean and turn of a segment in the axes of what carries it.

    Args:
        own: shape (frame, 3, 3): those axes.
        own_deg2: shape (frame, 3, 3): how well they are known, as :func:`axes_covariance` says it.
        turn: shape (frame, 3, 3): world from segment.
        turn_covariance: shape (frame, 3, 3): of a small turn about the segment's axes, rad^2.

    Returns:
        Shape (frame, 3), degrees.
    """
    here = carried_angles(own, turn)
    steps = Rotation.from_rotvec(_STEP * np.eye(3)).as_matrix()
    by_own = np.stack([_change(carried_angles(own @ step, turn), here) for step in steps], axis=-1)
    by_turn = np.stack([_change(carried_angles(own, turn @ step), here) for step in steps], axis=-1)
    variance = np.einsum("fai,fij,faj->fa", np.radians(by_own), own_deg2, by_own * np.pi / 180.0)
    variance += np.einsum("fai,fij,faj->fa", by_turn, turn_covariance, by_turn)
    return np.minimum(np.sqrt(variance), _UNKNOWN_DEG)


def _variances(derivative: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Shape (frame, reading)."""
    return np.maximum(((derivative @ covariance[:, 3:, 3:]) * derivative).sum(axis=-1), 0.0)


def _reader_of_angles(tree: Tree, up: tuple[float, float, float]) -> Read:
    """All joint angles."""
    return lambda turns, bones: joint_angles(tree, turns, bones[..., 2], up)[1]


def _reader_of_axes(tree: Tree, at: int, turns: np.ndarray, bones: np.ndarray) -> Read:
    """By how much the axes of what moves a node are turned from those in these poses."""
    node = tree.nodes[at]
    known = axes_at(tree, node, turns, full_rotations(tree, turns, bones[..., 2])[0])

    def read(turns: np.ndarray, bones: np.ndarray) -> np.ndarray:
        frames, unseen = full_rotations(tree, turns, bones[..., 2])
        found = _small_turn(known, axes_at(tree, node, turns, frames))
        return np.where(unseen[..., node.mover, None], np.nan, found) if node.is_bone else found

    return read


def _change(there: np.ndarray, here: np.ndarray) -> np.ndarray:
    """By how much angles in degrees differ a step away, per radian; the short way round."""
    return ((there - here + 180.0) % 360.0 - 180.0) / _STEP


def _small_turn(known: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """The turn from known axes to near ones, about the former, shape (..., 3), degrees."""
    r = np.swapaxes(known, -1, -2) @ axes
    differences = [r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]]
    return np.degrees(0.5 * np.stack(differences, axis=-1))


def _derivative(read: Read, turns: np.ndarray, bones: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Of readings by the numbers of the pose but for where the root is: shape (frame, reading, number).

    Args:
        read: gives the readings.
        turns: shape (frame, segment, 3, 3).
        bones: shape (frame, bone, 3, 3).
        groups: shape (number,): numbers of one group are moved together, and each of them gets all that came of it.
    """
    n_groups = int(groups.max(initial=-1)) + 1
    here = read(turns, bones)
    moved = read(*_moved(turns, bones, groups, n_groups))
    slopes = _change(moved, here)
    return np.moveaxis(slopes[groups], 0, -1)


def _moved(turns: np.ndarray, bones: np.ndarray, groups: np.ndarray, n_groups: int) -> tuple[np.ndarray, np.ndarray]:
    """Poses with the numbers of each group one step on: shapes (group, frame, ...)."""
    s, b = turns.shape[-3], bones.shape[-3]
    steps = _STEP * (groups == np.arange(n_groups)[:, None])
    by_segment = steps[:, : 3 * s].reshape(n_groups, s, 3)
    by_bone = np.pad(steps[:, 3 * s :].reshape(n_groups, b, 2), ((0, 0), (0, 0), (0, 1)))
    return _stepped(turns, by_segment), _stepped(bones, by_bone)


def _stepped(frames: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Frames (frame, n, 3, 3), each turned about its own axes by steps (group, n, 3)."""
    turn = Rotation.from_rotvec(steps.reshape(-1, 3)).as_matrix().reshape(*steps.shape, 3) if steps.size else None
    return frames[None] @ turn[:, None] if turn is not None else np.tile(frames, (len(steps), 1, 1, 1, 1))


@lru_cache(maxsize=64)
def _groups(tree: Tree, at: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Which numbers of a pose can be moved together, and which readings depend on which.

    Args:
        tree: of the body.
        at: of the axes at this node; None of all joint angles.

    Returns:
        Shape (number,): a group for each, such that no reading depends on two of one; and what
        depends on what, shape (reading, number), bool.
    """
    rng = np.random.default_rng(0)
    turns, bones = (_some_turns(n, rng) for n in (len(tree.segments), len(tree.bones)))
    read = _reader_of_angles(tree, (0.0, 0.0, 1.0)) if at is None else _reader_of_axes(tree, at, turns, bones)
    each = np.arange(3 * len(tree.segments) + 2 * len(tree.bones))
    slopes = np.nan_to_num(_derivative(read, turns, bones, each))
    depends = np.any(np.abs(slopes) > _SOME, axis=0, keepdims=True)[0]
    group = np.full(depends.shape[1], -1)
    for number in range(len(group)):
        clash = depends[depends[:, number]].any(axis=0)
        taken = set(group[clash].tolist())
        group[number] = next(g for g in range(len(group)) if g not in taken)
    return group, depends


def _some_turns(n: int, rng: np.random.Generator) -> np.ndarray:
    """Shape (probe, n, 3, 3)."""
    if not n:
        return np.empty((_PROBES, 0, 3, 3))
    return Rotation.random(_PROBES * n, rng=rng).as_matrix().reshape(_PROBES, n, 3, 3)
