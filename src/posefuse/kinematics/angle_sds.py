"""Standard deviations of joint angles, to first order, from the covariance of a pose. See docs/methods/angles.md.

Finite differences give the derivatives of angles with respect to the parameters of the pose. Parameters on which no
angle depends jointly are varied at the same time (Curtis, Powell and Reid 1974).
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from posefuse.arrays import ranges
from posefuse.kinematics.joint_angles import axes_at, joint_angles, relative_angles, root_angles
from posefuse.kinematics.twist import full_rotations
from posefuse.model.reconstruction import unpack_covariance
from posefuse.model.rotations import rotations_from_quaternions, rotations_from_vectors
from posefuse.model.track_events import Poses
from posefuse.skeleton.trees import Tree

_CHUNK = 512
"""Number of frames processed at a time."""
_STEP = 1e-6
_PROBES = 8
_MIN_SLOPE = 1e-3
_UNKNOWN_DEG = 180.0 / np.sqrt(3.0)
"""Standard deviation of a uniformly distributed angle; larger first-order values have no meaning."""

Read = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function from turns (..., segment, 3, 3) and bone frames (..., bone, 3, 3) to readings (..., reading), degrees."""


def joint_angle_sds(
    tree: Tree,
    turns: np.ndarray,
    bones: np.ndarray,
    covariance: np.ndarray,
    up: tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> np.ndarray:
    """Return the standard deviations of the angles of :func:`posefuse.kinematics.joint_angles.joint_angles`.

    Args:
        tree: Tree of the body.
        turns: shape (frame, segment, 3, 3): world from segment.
        bones: shape (frame, bone, 3, 3): the third axis is the bone's direction; errors are about the first two.
        covariance: shape (frame, pose, pose): covariance of the pose, in the tree's order.
        up: Up direction of the world.

    Returns:
        shape (frame, angle), in degrees; NaN where the angle is, and at most that of a uniform distribution.
    """
    groups, depends = _groups(tree, None)
    read, sds = _reader_of_angles(tree, up), np.empty((len(turns), len(depends)))
    for start, stop in ranges(len(turns), _CHUNK):
        to = slice(start, stop)
        derivative = _derivative(read, turns[to], bones[to], groups) * depends
        sds[to] = np.minimum(np.sqrt(_variances(derivative, covariance[to])), _UNKNOWN_DEG)
    return sds


def axes_covariance(tree: Tree, at: int, turns: np.ndarray, bones: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the covariance of the axes of a node's mover, including the twist.

    Args:
        tree: Tree of the body.
        at: Index of the node.
        turns: shape (frame, segment, 3, 3).
        bones: shape (frame, bone, 3, 3).
        covariance: shape (frame, pose, pose).

    Returns:
        shape (frame, 3, 3): covariance of a small turn about these axes, degrees^2; NaN where the twist is
            unobserved.
    """
    groups, depends = _groups(tree, at)
    out = np.empty((len(turns), 3, 3))
    for start, stop in ranges(len(turns), _CHUNK):
        to = slice(start, stop)
        read = _reader_of_axes(tree, at, turns[to], bones[to])
        derivative = _derivative(read, turns[to], bones[to], groups) * depends
        out[to] = derivative @ covariance[to, 3:, 3:] @ derivative.transpose(0, 2, 1)
    return out


def relative_angle_sds(
    own: np.ndarray, own_deg2: np.ndarray, turn: np.ndarray, turn_covariance: np.ndarray
) -> np.ndarray:
    """Return the standard deviations of bend, lean and turn of a segment relative to its carrier.

    Args:
        own: shape (frame, 3, 3): axes of the carrier.
        own_deg2: shape (frame, 3, 3): their covariance from :func:`axes_covariance`.
        turn: shape (frame, 3, 3): world from segment.
        turn_covariance: shape (frame, 3, 3): covariance of a small turn about the segment's axes, rad^2.

    Returns:
        shape (frame, 3), in degrees.
    """
    here = relative_angles(own, turn)
    steps = rotations_from_vectors(_STEP * np.eye(3))
    by_own = np.stack([_change(relative_angles(own @ step, turn), here) for step in steps], axis=-1)
    by_turn = np.stack([_change(relative_angles(own, turn @ step), here) for step in steps], axis=-1)
    variance = np.einsum("fai,fij,faj->fa", np.radians(by_own), own_deg2, by_own * np.pi / 180.0)
    variance += np.einsum("fai,fij,faj->fa", by_turn, turn_covariance, by_turn)
    return np.minimum(np.sqrt(variance), _UNKNOWN_DEG)


def root_angle_sds(
    turn: np.ndarray, turn_covariance: np.ndarray, up: tuple[float, float, float] = (0.0, 0.0, 1.0)
) -> np.ndarray:
    """Return the standard deviations of heading, tilt and list of a root segment.

    Args:
        turn: shape (..., 3, 3): world from segment.
        turn_covariance: shape (..., 3, 3): covariance of a small turn about the segment's axes, rad^2.
        up: Up direction of the world.

    Returns:
        shape (..., 3), in degrees, at most that of a uniform distribution.
    """
    here = root_angles(turn, up)
    steps = rotations_from_vectors(_STEP * np.eye(3))
    slopes = np.stack([_change(root_angles(turn @ step, up), here) for step in steps], axis=-1)
    variance = np.einsum("...ai,...ij,...aj->...a", slopes, turn_covariance, slopes)
    return np.minimum(np.sqrt(np.maximum(variance, 0.0)), _UNKNOWN_DEG)


def with_root_angle_sds(poses: Poses, up: tuple[float, float, float] | None) -> Poses:
    """Return poses with the standard deviations of the root's angles in a world with this up direction.

    Args:
        poses: Poses in that world; those without angles of a root remain as they are.
        up: Up direction of the world; None if unknown, then these standard deviations are NaN.
    """
    if not poses.segments or poses.angles[:1] != (f"{poses.segments[0]}.heading",):
        return poses
    sds = np.array(poses.angle_sd_deg[:])
    sds[..., :3] = np.nan
    if up is not None:
        covariance = unpack_covariance(poses.root_turn_rad2[:])
        sds[..., :3] = root_angle_sds(np.asarray(poses.turns[:])[:, :, 0], covariance, up)
    return replace(poses, angle_sd_deg=sds)


def _variances(derivative: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the variances of readings, shape (frame, reading)."""
    return np.maximum(((derivative @ covariance[:, 3:, 3:]) * derivative).sum(axis=-1), 0.0)


def _reader_of_angles(tree: Tree, up: tuple[float, float, float]) -> Read:
    """Return the function that reads all joint angles."""
    return lambda turns, bones: joint_angles(tree, turns, bones[..., 2], up)[1]


def _reader_of_axes(tree: Tree, at: int, turns: np.ndarray, bones: np.ndarray) -> Read:
    """Return the function that reads the turn of a node's axes relative to these poses."""
    node = tree.nodes[at]
    known = axes_at(tree, node, turns, full_rotations(tree, turns, bones[..., 2])[0])

    def read(turns: np.ndarray, bones: np.ndarray) -> np.ndarray:
        frames, unseen = full_rotations(tree, turns, bones[..., 2])
        found = _small_turn(known, axes_at(tree, node, turns, frames))
        return np.where(unseen[..., node.mover, None], np.nan, found) if node.is_bone else found

    return read


def _change(there: np.ndarray, here: np.ndarray) -> np.ndarray:
    """Return the slope of angles in degrees per radian, by the shorter way around the circle."""
    return ((there - here + 180.0) % 360.0 - 180.0) / _STEP


def _small_turn(known: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Return the small turn between axes, about the first ones, shape (..., 3), in degrees."""
    r = np.swapaxes(known, -1, -2) @ axes
    differences = [r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]]
    return np.degrees(0.5 * np.stack(differences, axis=-1))


def _derivative(read: Read, turns: np.ndarray, bones: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Return the derivative of readings with respect to all parameters but the root position.

    Args:
        read: Function that returns the readings.
        turns: shape (frame, segment, 3, 3).
        bones: shape (frame, bone, 3, 3).
        groups: shape (parameter,): parameters of one group are varied together, and each gets the whole change.

    Returns:
        shape (frame, reading, parameter).
    """
    n_groups = int(groups.max(initial=-1)) + 1
    here = read(turns, bones)
    moved = read(*_moved(turns, bones, groups, n_groups))
    slopes = _change(moved, here)
    return np.moveaxis(slopes[groups], 0, -1)


def _moved(turns: np.ndarray, bones: np.ndarray, groups: np.ndarray, n_groups: int) -> tuple[np.ndarray, np.ndarray]:
    """Return poses with the parameters of each group varied by one step, shapes (group, frame, ...)."""
    s, b = turns.shape[-3], bones.shape[-3]
    steps = _STEP * (groups == np.arange(n_groups)[:, None])
    by_segment = steps[:, : 3 * s].reshape(n_groups, s, 3)
    by_bone = np.pad(steps[:, 3 * s :].reshape(n_groups, b, 2), ((0, 0), (0, 0), (0, 1)))
    return _stepped(turns, by_segment), _stepped(bones, by_bone)


def _stepped(frames: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Turn frames (frame, n, 3, 3) about their own axes by steps (group, n, 3)."""
    return frames[None] @ rotations_from_vectors(steps)[:, None]


@lru_cache(maxsize=64)
def _groups(tree: Tree, at: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the parameters of a pose that can be varied together, and the readings that depend on each.

    Args:
        tree: Tree of the body.
        at: Node whose axes are read; None for all joint angles.

    Returns:
        Group of each parameter, shape (parameter,), such that no reading depends on two parameters of one group; and
        dependencies, shape (reading, parameter), bool.
    """
    rng = np.random.default_rng(0)
    turns, bones = (_some_turns(n, rng) for n in (len(tree.segments), len(tree.bones)))
    read = _reader_of_angles(tree, (0.0, 0.0, 1.0)) if at is None else _reader_of_axes(tree, at, turns, bones)
    each = np.arange(3 * len(tree.segments) + 2 * len(tree.bones))
    slopes = np.nan_to_num(_derivative(read, turns, bones, each))
    depends = np.any(np.abs(slopes) > _MIN_SLOPE, axis=0, keepdims=True)[0]
    group = np.full(depends.shape[1], -1)
    for number in range(len(group)):
        clash = depends[depends[:, number]].any(axis=0)
        taken = set(group[clash].tolist())
        group[number] = next(g for g in range(len(group)) if g not in taken)
    return group, depends


def _some_turns(n: int, rng: np.random.Generator) -> np.ndarray:
    """Return random rotations, shape (probe, n, 3, 3)."""
    return rotations_from_quaternions(rng.normal(size=(_PROBES, n, 4)))
