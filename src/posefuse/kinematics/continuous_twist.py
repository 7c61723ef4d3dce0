"""Axial rotation (twist) of limbs for animation, continuous in time even while a limb is straight.

:func:`posefuse.kinematics.twist.full_rotations` estimates the twist from a single frame. While an elbow is straight,
its bending plane is undefined, and it may reappear in another direction; the skin of an animated character would flip.
This module also uses neighboring frames: see docs/methods/angles.md.
"""

import numpy as np

from posefuse.kinematics.twist import about_third_axis, bending_axis, carrier, in_order, least_rotation, rest_frames
from posefuse.skeleton.trees import Tree

SMOOTH_S = 0.15
"""Standard deviation, in seconds, of the Gaussian weights of neighboring frames."""
_REACH = 3.0
_REST_WEIGHT = np.sin(np.radians(5.0)) ** 2
"""Weight of the least rotation, compared with a bending plane that is weighted by the squared sine of the bend."""


def reach_frames(tree: Tree, step_s: float) -> int:
    """Return the number of frames before and after a frame that influence its twist.

    Args:
        tree: tree of the body; the reach adds up along chains of bones.
        step_s: time between frames.
    """
    parents = _parent_bones(tree)
    depth = np.zeros(len(tree.bones), dtype=np.int64)
    for bone in in_order(tree):
        before = carrier(tree, bone)[0]
        depth[bone] = (depth[before] if before >= 0 else 0) + (bone in parents)
    return 2 * int(depth.max(initial=0)) * _half(step_s)


def _half(step_s: float) -> int:
    return int(np.ceil(_REACH * SMOOTH_S / step_s))


def _parent_bones(tree: Tree) -> set[int]:
    """Return the bones that have child bones."""
    return {carrier(tree, bone)[0] for bone in range(len(tree.bones))}


def steady_rotations(tree: Tree, turns: np.ndarray, directions: np.ndarray, step_s: float) -> np.ndarray:
    """Return rotations of bones with smoothly varying twist: world from bone, shape (frame, bone, 3, 3).

    The axes are those of :func:`posefuse.kinematics.twist.full_rotations`. The twist of a bone, relative to the
    least rotation, is the circular mean of the twists given by the bending planes of the neighboring frames. Weights
    are the squared sine of the bend (the error of the twist grows with its inverse) times a Gaussian of ``SMOOTH_S``.
    The mean is smoothed by the same Gaussian once more. The last bone of a chain follows from its parent by the least
    rotation.

    Args:
        tree: tree of the body.
        turns: shape (frame, segment, 3, 3): world from segment.
        directions: shape (frame, bone, 3): unit vectors, NaN where unknown.
        step_s: time between frames.
    """
    rest = rest_frames(tree)
    out = np.empty((*directions.shape, 3))
    weights = _gaussian(step_s)
    parents = _parent_bones(tree)
    for bone in in_order(tree):
        out[:, bone] = least_rotation(tree, bone, turns, directions, out, rest)
        if bone in parents:
            axis, bend = bending_axis(tree, bone, directions, out[:, bone, :, 1])
            out[:, bone] = out[:, bone] @ about_third_axis(_twist(out[:, bone], axis, bend, weights))
    return out


def _gaussian(step_s: float) -> np.ndarray:
    reach = _half(step_s)
    weights = np.exp(-0.5 * (step_s * np.arange(-reach, reach + 1) / SMOOTH_S) ** 2)
    return weights / weights.sum()


def _twist(least: np.ndarray, axis: np.ndarray, bend: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the twist relative to the least rotation, shape (frame,), radians."""
    twist = np.einsum("fi,fi->f", axis, least[..., 1]) - 1j * np.einsum("fi,fi->f", axis, least[..., 0])
    observed = np.nan_to_num(np.sin(bend) ** 2 * twist)
    mean = _smooth(observed, weights) + _REST_WEIGHT
    # Strongly unequal weights make the mean jump from one side of a straight limb to the other, so it is smoothed too.
    has_bend = np.isfinite(bend)
    return np.angle(_smooth(np.where(has_bend, mean / np.abs(mean), 0.0), weights))


def _smooth(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    # mode="same" returns the length of the weights if they are longer than the values.
    half = len(weights) // 2
    return np.convolve(values, weights)[half : half + len(values)]
