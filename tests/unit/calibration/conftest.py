"""Rigs and observations shared by the tests of calibration."""

import numpy as np

from posefuse.calibration.parameters import N_PARAMETERS, apply_changes
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.skeleton.skeletons import Skeleton

NOISE_PX = 1.0


def observe(rig: CameraRig, seed: int = 0, frames: int = 40, keypoints: int = 10) -> Detections:
    """Return noisy observations of random points in every frame."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-1.5, -1.5, 0.0], [1.5, 1.5, 2.0], (frames, keypoints, 3))
    pixels = rig.project(points)
    pixels += rng.normal(0.0, NOISE_PX, pixels.shape)
    names = tuple(f"point_{k}" for k in range(keypoints))
    return Detections.from_dense(Skeleton("points", names), rig.names, pixels, rate_hz=30.0)


def moved(rig: CameraRig, name: str, **numbers: float) -> CameraRig:
    """Return the rig with one camera rotated (y_rad) or shifted (x_m, y_m)."""
    change = np.zeros((len(rig), N_PARAMETERS))
    change[rig.index(name), [1, 3, 4]] = [numbers.get(key, 0.0) for key in ("y_rad", "x_m", "y_m")]
    return apply_changes(rig, change)


ONE = Options(people="one")
