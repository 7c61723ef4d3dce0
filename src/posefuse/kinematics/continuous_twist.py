"""Continuous twist of limbs, for animation: without jumps where a limb is straight and the twist is not observed.

:func:`posefuse.kinematics.twist.full_rotations` uses one frame at a time. When an elbow is extended, the plane in which
it bends is unobserved for some frames and then observed elsewhere, so the skin of a character would jump. This
module also uses the surrounding frames. See docs/methods/angles.md.
"""

import numpy as np

from posefuse.kinematics.twist import (
    about_third_axis,
    bending_axis,
    bones_in_order,
    carrier,
    least_rotation,
    rest_frames,
)
from posefuse.skeleton.trees import Tree

SMOOTH_S = 0.15
"""Standard deviation of the temporal weights of the observed twists, in seconds."""
_REACH = 3.0
_REST_WEIGHT = np.sin(np.radians(5.0)) ** 2
"""Weight of the least rotation relative to that of an observed plane, which is the squared sine of the bend."""


def reach_frames(tree: Tree, step_s: float) -> int:
    """Return the number of frames before and after a frame that influence it.

    Args:
        tree: Tree of the body; along a chain of bones, the influences add up.
        step_s: Time between frames, in seconds.
    """
    carrying = _carrying(tree)
    deep = np.zeros(len(tree.bones), dtype=np.int64)
    for bone in bones_in_order(tree):
        before = carrier(tree, bone)[0]
        deep[bone] = (deep[before] if before >= 0 else 0) + (bone in carrying)
    return 2 * int(deep.max(initial=0)) * _half(step_s)


def _half(step_s: float) -> int:
    return int(np.ceil(_REACH * SMOOTH_S / step_s))


def _carrying(tree: Tree) -> set[int]:
    """Return the bones that carry other bones."""
    return {carrier(tree, bone)[0] for bone in range(len(tree.bones))}


def smooth_rotations(tree: Tree, turns: np.ndarray, directions: np.ndarray, step_s: float) -> np.ndarray:
    """Return rotations of bones with a smooth twist: world from bone, shape (frame, bone, 3, 3).

    The axes are those of :func:`posefuse.kinematics.twist.full_rotations`. A bone's twist relative to the least
    rotation is the circular mean of the twists that the plane of the bend shows in the surrounding frames, weighted by
    the squared sine of the bend (the error of the twist is inversely proportional to the sine) and by a Gaussian of
    ``SMOOTH_S``. The same Gaussian smooths that mean once more. The last bone of a chain follows from the one before by
    the least rotation.

    Args:
        tree: Tree of the body.
        turns: shape (frame, segment, 3, 3): world from segment.
        directions: shape (frame, bone, 3): unit vectors, NaN where unknown.
        step_s: Time between frames, in seconds.
    """
    rest = rest_frames(tree)
    out = np.empty((*directions.shape, 3))
    weights = _gaussian(step_s)
    carrying = _carrying(tree)
    for bone in bones_in_order(tree):
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
    """Return the twist, shape (frame,), in radians."""
    across = np.einsum("fi,fi->f", axis, least[..., 1]) - 1j * np.einsum("fi,fi->f", axis, least[..., 0])
    shown = np.nan_to_num(np.sin(bend) ** 2 * across)
    mean = _smooth(shown, weights) + _REST_WEIGHT
    # Such unequal weights switch from one side of a straight limb to the other at once: smooth the mean, too.
    known = np.isfinite(bend)
    return np.angle(_smooth(np.where(known, mean / np.abs(mean), 0.0), weights))


def _smooth(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    # Mode "same" returns the length of the weights if these are longer than the values.
    half = len(weights) // 2
    return np.convolve(values, weights)[half : half + len(values)]
