"""The person faces along a direction of the scene all the time: left is up x facing.

In a right-handed world with z up a person who faces +x has the left at +y, one who faces +y at -x.
"""

import numpy as np

from posefuse.errors import OptionsError
from posefuse.left_right.layout import Layout
from posefuse.left_right.results import PairsInTime, Sides
from posefuse.left_right.view_swaps import views_of
from posefuse.model.options.left_right import SideOptions, facing_vector

_TWIST_DEG = 45.0


def decide(given: PairsInTime, options: SideOptions) -> Sides:
    """Decide every pair by where its points lie along the person's left.

    Args:
        given: pairs, and a rig that knows which way is up.
        options: ``facing`` says where the person faces.

    Raises:
        OptionsError: where the rig does not say which way is up, or facing is up or down.
    """
    left = left_of(given, options)
    points = given.pairs.points_m
    layout = Layout.of(given.skeleton)
    flipped = given.by_frame((points[:, :, 1] - points[:, :, 0]) @ left > 0.0)
    notes = twist_notes(given, left, flipped)
    return Sides(flipped, views_of(given, flipped, layout, options), layout.chains, notes)


def left_of(given: PairsInTime, options: SideOptions) -> np.ndarray:
    """Shape (3,): the unit vector to the left of a person who faces as the options say."""
    up = up_of(given)
    left = np.cross(up, facing_vector(options.facing))
    if np.linalg.norm(left) < 1e-6:
        raise OptionsError(
            f"side_search.facing is {options.facing!r}, which is up or down in this world ({given.rig.up_axis} is up): "
            "a person faces along the floor."
        )
    return left / np.linalg.norm(left)


def up_of(given: PairsInTime) -> np.ndarray:
    """Shape (3,): the rig's up axis."""
    if given.rig.up_axis is None:
        raise OptionsError(
            "sides = 'plane', but the calibration does not say which way is up. Say it with up, such as z, or "
            "choose the method 'chains', which need not know."
        )
    return facing_vector(given.rig.up_axis)


def twist_notes(given: PairsInTime, left: np.ndarray, flipped: np.ndarray) -> tuple[str, ...]:
    """One warning if shoulders and hips are ever twisted against each other beyond what the rule stands."""
    names = [pair[0] for pair in given.skeleton.pairs]
    if not {"left_shoulder", "left_hip"} <= set(names):
        return ()
    points, up = given.by_frame(given.pairs.points_m), up_of(given)
    forward = np.cross(left, up)

    def angle(name: str) -> np.ndarray:
        k = names.index(name)
        leftward = points[:, :, k, 0] - points[:, :, k, 1]
        leftward = np.where(flipped[:, :, k, None], -leftward, leftward)
        return np.arctan2(leftward @ forward, leftward @ left)

    twist = np.degrees(np.abs(np.angle(np.exp(1j * (angle("left_shoulder") - angle("left_hip"))))))
    known = np.isfinite(twist)
    if not (twist[known] > _TWIST_DEG).any():
        return ()
    return (
        f"Shoulders are twisted against hips by more than {_TWIST_DEG:.0f} degrees (up to {twist[known].max():.0f}) in "
        f"{int((twist[known] > _TWIST_DEG).sum())} of {int(known.sum())} frames: there, telling left from right by the "
        "direction that the person faces is unsound. The method 'chains' does not need it.",
    )
