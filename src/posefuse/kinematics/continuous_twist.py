"""How limbs are turned about themselves, for animation: without jumps where a limb is straight and nothing tells it.

:func:`posefuse.kinematics.twist.full_rotations` says what a frame shows by itself. When an elbow stretches, the plane in
which it bends is lost in a few frames, and found again somewhere else; a character whose skin follows would flap. Here
the frames around tell too: see docs/methods.md, "Figures for animation".
"""

import numpy as np

from posefuse.kinematics.twist import about_third_axis, bending_axis, carrier, in_order, least_rotation, rest_frames
from posefuse.skeleton.trees import Tree

SMOOTH_S = 0.15
"""Standard deviation of the weights, in time, with which frames tell a twist."""
_REACH = 3.0
_REST_WEIGHT = np.sin(np.radians(5.0)) ** 2
"""What the least rotation counts beside a plane seen with the squared sine of the bend."""


def reach_frames(tree: Tree, step_s: float) -> int:
    """How many frames before and after one have a bearing on it.

    Args:
        tree: of the body; where bones carry bones, the frames around those that count for one count for the next.
        step_s: between frames.
    """
    carrying = _carrying(tree)
    deep = np.zeros(len(tree.bones), dtype=np.int64)
    for bone in in_order(tree):
        before = carrier(tree, bone)[0]
        deep[bone] = (deep[before] if before >= 0 else 0) + (bone in carrying)
    return 2 * int(deep.max(initial=0)) * _half(step_s)


def _half(step_s: float) -> int:
    return int(np.ceil(_REACH * SMOOTH_S / step_s))


def _carrying(tree: Tree) -> set[int]:
    """The bones on which others hang."""
    return {carrier(tree, bone)[0] for bone in range(len(tree.bones))}


def steady_rotations(tree: Tree, turns: np.ndarray, directions: np.ndarray, step_s: float) -> np.ndarray:
    """Rotations of bones with a twist that changes smoothly: world from bone, shape (frame, bone, 3, 3).

    The axes are those of :func:`posefuse.kinematics.twist.full_rotations`. A bone's twist from the least rotation is the
    mean, on the circle, of those that the plane of the bend shows in the frames around, each weighed by the squared
    sine of the bend (the twist's error goes with its inverse) and by a Gaussian of ``SMOOTH_S``; the course of that
    mean is smoothed by the same Gaussian once more. The last bone of a chain follows from the one before by the least
    rotation.

    Args:
        tree: of the body.
        turns: shape (frame, segment, 3, 3): world from segment.
        directions: shape (frame, bone, 3): unit vectors, NaN where unknown.
        step_s: between frames.
    """
    rest = rest_frames(tree)
    out = np.empty((*directions.shape, 3))
    weights = _gaussian(step_s)
    carrying = _carrying(tree)
    for bone in in_order(tree):
        out[:, bone] = least_rotation(tree, bone, turns, directions, out, rest)
        if bone in carrying:
            axis, bend = bending_axis(tree, bone, directions, out[:, bone, :, 1])
            out[:, bone] = out[:, bone] @ about_third_axis(_twist(out[:, bone], axis, bend, weights))
    return out


def _gaussian(step_s: float) -> np.ndarray:
    reach = _half(step_s)
    weights = np.exp(-0.5 * (step_s * np.arange(-reach, reach + 1) / SMOOTH_S) ** 2)
    return weights / weights.sum()


def _twist(least: np.ndarray, axis: np.ndarray, bend: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Shape (frame,), radians."""
    across = np.einsum("fi,fi->f", axis, least[..., 1]) - 1j * np.einsum("fi,fi->f", axis, least[..., 0])
    shown = np.nan_to_num(np.sin(bend) ** 2 * across)
    mean = _smooth(shown, weights) + _REST_WEIGHT
    # Weights so unlike pass from one side of a straight limb to the other at once: the mean's course is smoothed too.
    known = np.isfinite(bend)
    return np.angle(_smooth(np.where(known, mean / np.abs(mean), 0.0), weights))


def _smooth(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    # Whole, then cut: "same" is as long as the weights where these are longer.
    half = len(weights) // 2
    return np.convolve(values, weights)[half : half + len(values)]
