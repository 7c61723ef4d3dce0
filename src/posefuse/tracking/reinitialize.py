"""Reinitialization of directions that the prediction does not know, from the points that the views show.

If the time between frames exceeds the time in which limbs turn, the last frame does not constrain the direction of a
limb. Gauss-Newton steps from there end in an arbitrary minimum. As for a new body, the steps must start where the views
show the limb.
"""

import math

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.kinematics.initial_pose import bone_vectors, pose_from_points, turn_bones
from posefuse.tracking.settings import TrackerSettings


def is_long_gap(dt_s: float, settings: TrackerSettings) -> bool:
    """Return whether directions become unknown within a time.

    A direction with the stationary distribution of velocities turns by the variance
    ``q T^2 (dt - T (1 - exp(-dt / T)))``.
    """
    share = settings.options.reinitialization.unknown_share
    for q, decay, most in settings.turning_motions:
        turned = q * decay**2 * (dt_s - decay * (1.0 - math.exp(-dt_s / decay)))
        if turned > share * most:
            return True
    return False


def has_unknown_directions(state: State, settings: TrackerSettings) -> np.ndarray:
    """Return which segments and bones are predicted no better than those of a new body, shape (track, mover), bool."""
    n, segments, people = settings.tree.n_pose, len(settings.tree.segments), len(state.root)
    columns = np.arange(3, n)
    share = settings.options.reinitialization.unknown_share
    vague = state.covariance[:, columns, columns] > share * settings.most[columns]
    turns, bones = vague[:, : 3 * segments].reshape(people, -1, 3), vague[:, 3 * segments :].reshape(people, -1, 2)
    return np.concatenate([turns.all(axis=2), bones.all(axis=2)], axis=1)


def reinitialize_directions(
    state: State, body: int, which: np.ndarray, points_m: np.ndarray, settings: TrackerSettings
) -> None:
    """Turn segments and bones of one body to where they are shown; the covariance stays.

    Args:
        state: Updated in place.
        body: Index of the body.
        which: shape (segment + bone,), bool.
        points_m: shape (keypoint, 3): points that the views show, NaN where there are none.
        settings: Settings of the tracker.
    """
    if not np.isfinite(points_m).any():
        return
    tree, segments = settings.tree, len(settings.tree.segments)
    shown = bone_vectors(tree, points_m)
    bones = np.flatnonzero(which[segments:] & np.isfinite(shown).all(axis=1))
    turned = np.flatnonzero(which[:segments])
    if len(turned):
        state.turns[body, turned] = pose_from_points(tree, points_m, state.shape[body])[1][turned]
    turn_bones(state.bones[body], shown, bones)


def reinitialize_limb(state: State, body: int, keypoint: int, points_m: np.ndarray, settings: TrackerSettings) -> bool:
    """Turn the bones that lead to a keypoint to where they are shown, with the uncertainty of a new body.

    Args:
        state: Updated in place.
        body: Index of the body.
        keypoint: Keypoint at the end of the limb.
        points_m: shape (keypoint, 3): points that the views show, NaN where there are none.
        settings: Settings of the tracker.

    Returns:
        Whether any bones lead to the keypoint.
    """
    tree = settings.tree
    node = int(tree.keypoint_nodes[keypoint])
    bones: list[int] = []
    while node > 0 and tree.nodes[node].is_bone:
        bones.append(tree.nodes[node].mover)
        node = tree.nodes[node].parent
    if not bones:
        return False
    turn_bones(state.bones[body], bone_vectors(tree, points_m), bones)
    columns = np.array([3 + 3 * len(tree.segments) + 2 * bone + i for bone in bones for i in range(2)])
    _reset_covariance(state, body, columns, settings)
    return True


def _reset_covariance(state: State, body: int, columns: np.ndarray, settings: TrackerSettings) -> None:
    """Give columns of one body's pose the uncertainty of a new body, and set their velocities to zero."""
    cov = state.covariance[body]
    velocities = len(cov) - settings.tree.n_pose + columns
    both = np.concatenate([columns, velocities])
    cov[both], cov[:, both] = 0.0, 0.0
    cov[columns, columns] = settings.most[columns]
    cov[velocities, velocities] = 0.5 * settings.power[columns] * settings.decay_s[columns]
    state.velocity[body, columns] = 0.0
