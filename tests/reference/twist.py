"""Rotations of bones with a twist, bone by bone with NumPy."""

import numpy as np

from posefuse.kinematics.twist import about_third_axis, bending_axis, bones_in_order, least_rotation, rest_frames
from posefuse.skeleton.trees import Tree


def full_rotations(tree: Tree, turns: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations and unobserved twists, as :func:`posefuse.kinematics.twist.full_rotations`."""
    straight, bent = np.radians(5.0), np.radians(15.0)
    out = np.empty((*directions.shape, 3))
    unseen = np.ones(directions.shape[:-1], dtype=bool)
    for bone in bones_in_order(tree):
        least = least_rotation(tree, bone, turns, directions, out, rest_frames(tree))
        axis, bend = bending_axis(tree, bone, directions, least[..., 1])
        share = np.clip((bend - straight) / (bent - straight), 0.0, 1.0)
        first, second = (np.einsum("...i,...i->...", axis, least[..., i]) for i in (0, 1))
        out[..., bone, :, :] = least @ about_third_axis(share * np.arctan2(-first, second))
        unseen[..., bone] = ~(share >= 1.0)
    return out, unseen
