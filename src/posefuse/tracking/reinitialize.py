"""What is foretold as badly as if it had never been seen is begun anew from where views show it.

Where frames come more rarely than limbs turn, the last frame tells nothing of where a limb points. Small steps from
there end anywhere: as with somebody new, the steps have to begin where the views themselves put the limb.
"""

import math

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.kinematics.initial_pose import aim, bones_shown, pose_from_points
from posefuse.tracking.settings import Settings

_UNKNOWN = 0.5
"""Of the variance of a direction that is as good as unknown: with more, the steps begin where views show it."""


def are_rare(dt_s: float, settings: Settings) -> bool:
    """Whether so long a time makes turning segments or bones as unknown as those of somebody new.

    In it a direction whose velocity is as usual turns by ``q T^2 (dt - T (1 - exp(-dt / T)))``, variance.
    """
    # One segment moves by the law of all, one bone too; both are last and first after the root.
    for i in (3, settings.tree.n_pose - 1):
        q, decay = float(settings.power[i]), float(settings.decay_s[i])
        turned = q * decay**2 * (dt_s - decay * (1.0 - math.exp(-dt_s / decay)))
        if turned > _UNKNOWN * float(settings.most[i]):
            return True
    return False


def unknown(state: State, settings: Settings) -> np.ndarray:
    """Shape (track, segment + bone), bool: whose directions are foretold no better than those of somebody new."""
    n, segments, people = settings.tree.n_pose, len(settings.tree.segments), len(state.root)
    columns = np.arange(3, n)
    vague = state.covariance[:, columns, columns] > _UNKNOWN * settings.most[columns]
    turns, bones = vague[:, : 3 * segments].reshape(people, -1, 3), vague[:, 3 * segments :].reshape(people, -1, 2)
    return np.concatenate([turns.all(axis=2), bones.all(axis=2)], axis=1)


def begin_anew(state: State, p: int, which: np.ndarray, points_m: np.ndarray, settings: Settings) -> None:
    """Turn somebody's segments and bones to where they are shown; how well they are known stays.

    Args:
        state: in and out.
        p: whose.
        which: shape (segment + bone,), bool.
        points_m: shape (keypoint, 3): where the views show the body's points, NaN where they do not.
        settings: of the tracker.
    """
    if not np.isfinite(points_m).any():
        return
    tree, segments = settings.tree, len(settings.tree.segments)
    shown = bones_shown(tree, points_m)
    bones = np.flatnonzero(which[segments:] & np.isfinite(shown).all(axis=1))
    turned = np.flatnonzero(which[:segments])
    if len(turned):
        state.turns[p, turned] = pose_from_points(tree, points_m, state.shape[p])[1][turned]
    aim(state.bones[p], shown, bones)


def forget(state: State, p: int, columns: np.ndarray, settings: Settings) -> None:
    """Let some numbers of somebody's pose be as little known as those of somebody new, and their velocities none."""
    cov = state.covariance[p]
    velocities = len(cov) - settings.tree.n_pose + columns
    both = np.concatenate([columns, velocities])
    cov[both], cov[:, both] = 0.0, 0.0
    cov[columns, columns] = settings.most[columns]
    cov[velocities, velocities] = 0.5 * settings.power[columns] * settings.decay_s[columns]
    state.velocity[p, columns] = 0.0
