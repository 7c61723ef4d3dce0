"""People with known coordinates, for tests of the estimation of joint angles."""

import numpy as np

from posefuse.biomechanics.inverse_kinematics import PersonPoints, person_points
from posefuse.biomechanics.marker_model import MarkerModel, marker_model
from posefuse.skeleton.skeletons import find_skeleton

SKELETON = find_skeleton("halpe_26")


def model_of(name: str = "halpe_26") -> MarkerModel:
    """Return the unscaled model of a skeleton."""
    model = marker_model(find_skeleton(name))
    assert model is not None
    return model


def gait(model: MarkerModel, frames: int) -> np.ndarray:
    """Return coordinates of one gait cycle per second at 30 Hz, shape (frame, coordinate)."""
    coordinates = np.zeros((frames, len(model.anatomy.coordinates)))
    phase = 2.0 * np.pi * np.arange(frames) / 30.0

    def put(name: str, degrees: np.ndarray) -> None:
        coordinates[:, model.anatomy.coordinate_index(name)] = np.radians(degrees)

    for side, shift in (("r", 0.0), ("l", np.pi)):
        put(f"hip_flexion_{side}", 10.0 + 20.0 * np.cos(phase + shift))
        put(f"hip_adduction_{side}", 3.0 * np.cos(phase + shift))
        put(f"knee_angle_{side}", 30.0 + 25.0 * np.cos(phase + shift + 1.3))
        put(f"ankle_angle_{side}", 10.0 * np.sin(phase + shift))
        put(f"arm_add_{side}", -15.0 + 5.0 * np.cos(phase))
        put(f"arm_flex_{side}", -20.0 * np.cos(phase + shift))
        put(f"elbow_flex_{side}", 40.0 + 10.0 * np.cos(phase + shift))
    put("pelvis_tilt", -3.0 + 2.0 * np.cos(2.0 * phase))
    put("lumbar_rotation", 6.0 * np.cos(phase))
    return coordinates


def points_of(model: MarkerModel, coordinates: np.ndarray, noise_m: float, seed: int = 0) -> PersonPoints:
    """Return noisy points of a model in coordinates, in a world with y up."""
    markers = model.markers
    exact = model.anatomy.marker_positions(model.scales, coordinates, markers.bodies, markers.locations_m)
    points = np.full((len(exact), int(model.columns.max()) + 1, 3), np.nan)
    points[:, model.columns] = exact + noise_m * np.random.default_rng(seed).standard_normal(exact.shape)
    covariance = np.broadcast_to([1.0, 0.0, 0.0, 1.0, 0.0, 1.0], (*points.shape[:2], 6)) * noise_m**2
    return person_points(model, points, covariance, np.eye(3))
