"""Assign left and right from a constant facing direction: left is up x facing.

In a right-handed world with z up, the left side of a person facing +x is toward +y, and of a person facing +y toward
-x.
"""

import numpy as np

from posefuse.errors import OptionsError
from posefuse.left_right.layout import Layout
from posefuse.left_right.results import PairSequence, SideAssignment
from posefuse.left_right.view_swaps import view_swap_states
from posefuse.model.options.left_right import SideOptions, facing_vector

_MAX_TWIST_DEG = 45.0


def assign(sequence: PairSequence, options: SideOptions) -> SideAssignment:
    """Assign left and right by the position of the two points along the person's left.

    Args:
        sequence: pairs, and a rig with a known up axis.
        options: ``facing`` sets the facing direction.

    Raises:
        OptionsError: if the up axis of the rig is unknown, or the facing direction is vertical.
    """
    left = left_direction(sequence, options)
    points = sequence.pairs.points_m
    layout = Layout.of(sequence.skeleton)
    flipped = sequence.by_frame((points[:, :, 1] - points[:, :, 0]) @ left > 0.0)
    notes = twist_notes(sequence, left, flipped)
    return SideAssignment(flipped, view_swap_states(sequence, flipped, layout, options), layout.chains, notes)


def left_direction(sequence: PairSequence, options: SideOptions) -> np.ndarray:
    """Return the unit vector to the person's left, shape (3,)."""
    up = up_direction(sequence)
    left = np.cross(up, facing_vector(options.facing))
    if np.linalg.norm(left) < 1e-6:
        raise OptionsError(
            f"side_search.facing is {options.facing!r}, which is vertical because the up axis is "
            f"{sequence.rig.up_axis}. Set a horizontal direction."
        )
    return left / np.linalg.norm(left)


def up_direction(sequence: PairSequence) -> np.ndarray:
    """Return the rig's up axis, shape (3,)."""
    if sequence.rig.up_axis is None:
        raise OptionsError(
            "sides = 'plane' needs the up axis, which the calibration does not define. Set it with up, such as z, or "
            "choose the method 'chains', which does not need it."
        )
    return facing_vector(sequence.rig.up_axis)


def twist_notes(sequence: PairSequence, left: np.ndarray, flipped: np.ndarray) -> tuple[str, ...]:
    """Return a warning if shoulders and hips are twisted by more than the method tolerates."""
    names = [pair[0] for pair in sequence.skeleton.pairs]
    if not {"left_shoulder", "left_hip"} <= set(names):
        return ()
    points, up = sequence.by_frame(sequence.pairs.points_m), up_direction(sequence)
    forward = np.cross(left, up)

    def angle(name: str) -> np.ndarray:
        k = names.index(name)
        leftward = points[:, :, k, 0] - points[:, :, k, 1]
        leftward = np.where(flipped[:, :, k, None], -leftward, leftward)
        return np.arctan2(leftward @ forward, leftward @ left)

    twist = np.degrees(np.abs(np.angle(np.exp(1j * (angle("left_shoulder") - angle("left_hip"))))))
    known = np.isfinite(twist)
    if not (twist[known] > _MAX_TWIST_DEG).any():
        return ()
    return (
        f"Shoulders are twisted relative to the hips by more than {_MAX_TWIST_DEG:.0f} degrees (up to "
        f"{twist[known].max():.0f}) in {int((twist[known] > _MAX_TWIST_DEG).sum())} of {int(known.sum())} frames, "
        "where the facing direction does not determine left and right reliably. The method 'chains' does not need it.",
    )
