"""A mouse in view of three cameras."""

import numpy as np
from benchmarks.animal_scenes import animal_rig

from posefuse.kernels.tracking.records import State
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.tracking.settings import TrackerSettings

MOUSE = shipped_skeleton("mouse_22")
RIG = animal_rig(3, 0.5)
SETTINGS = TrackerSettings.of(RIG, MOUSE, NoiseModel(np.full(3, 5.0), 1.0), TrackerOptions())
TREE = SETTINGS.tree


def standing(at_m: np.ndarray) -> State:
    """Return the state of a mouse at rest with a small covariance."""
    points = np.full((len(MOUSE), 3), np.nan)
    points[MOUSE.index("spine_middle")] = at_m
    state = initial_state(
        TREE, points, np.asarray(TREE.shape_m), np.asarray(TREE.shape_covariance), SETTINGS.options.motion
    )
    state.covariance[:] *= 1e-3
    return state
