"""Results of people whose points are the markers of the anatomical model, for the tests of OpenSim."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import posefuse
from posefuse.biomechanics.marker_model import MarkerModel, marker_model
from posefuse.io.results.axes import y_up_from_world
from posefuse.model.options.options import Options
from posefuse.model.options.subject import SubjectOptions
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.figures import model_layer
from tests.scenes import ring

FRAMES, RATE_HZ = 12, 60.0
FLEXED_DEG = {"knee_angle": 40.0, "elbow_flex": 60.0, "hip_flexion": 20.0, "pro_sup": 60.0, "arm_flex": 10.0}
"""A pose in which no limb is straight, so that points show every rotation."""


def model_of(name: str) -> MarkerModel:
    model = marker_model(shipped_skeleton(name))
    assert model is not None
    return model


def flexed(model: MarkerModel) -> np.ndarray:
    q = model.anatomy.defaults.copy()
    for name, degrees in FLEXED_DEG.items():
        for side in "rl":
            q[model.anatomy.coordinate_index(f"{name}_{side}")] = np.radians(degrees)
    return q


def walking(model: MarkerModel, heading_deg: float = 70.0) -> np.ndarray:
    """Return coordinates of a person who moves all large joints and faces another direction than x."""
    q = np.repeat(flexed(model)[None], FRAMES, axis=0)
    phase = 2 * np.pi * np.arange(FRAMES) / FRAMES
    for name, amplitude in {"hip_flexion": 20.0, "knee_angle": 20.0, "ankle_angle": 10.0, "arm_flex": 15.0}.items():
        for sign, side in ((1, "r"), (-1, "l")):
            q[:, model.anatomy.coordinate_index(f"{name}_{side}")] += np.radians(amplitude) * sign * np.sin(phase)
    q[:, model.anatomy.coordinate_index("pelvis_rotation")] = np.radians(heading_deg)
    q[:, model.anatomy.coordinate_index("pelvis_tx")] = 0.01 * np.arange(FRAMES)
    return q


def recorded(
    path: Path,
    size: float = 1.05,
    static: str | None = None,
    *,
    skeleton: str = "halpe_26",
    headings_deg: Sequence[float] = (70.0,),
    people: Sequence[str] = ("anna",),
) -> Reconstruction:
    """Write a result of walking people whose points are the model's markers.

    Args:
        path: folder of the result.
        size: size of the first person relative to the model; each further person is 5 % smaller.
        static: static trial.
        skeleton: name of the skeleton.
        headings_deg: direction that each person faces.
        people: names.
    """
    model, rig = model_of(skeleton), ring(3)
    points = np.full((FRAMES, len(people), len(shipped_skeleton(skeleton)), 3), np.nan)
    for p, heading_deg in enumerate(headings_deg):
        scales, q = size * 0.95**p * model.anatomy.unscaled(), walking(model, heading_deg)
        places = model.anatomy.marker_positions(scales, q, model.markers.bodies, model.markers.locations_m)
        points[:, p, model.columns] = places @ y_up_from_world(rig.up_axis)
    layer = model_layer(points)
    covariance = np.full(layer.covariance_m2.shape, 0.0)
    covariance[..., [0, 3, 5]] = 0.005**2
    layer = replace(layer, covariance_m2=np.where(np.isfinite(points[..., :1]), covariance, np.nan))
    result = Reconstruction(
        rig=rig, skeleton=shipped_skeleton(skeleton), person_ids=tuple(people), frame_numbers=np.arange(FRAMES),
        time_s=np.arange(FRAMES) / RATE_HZ, layers={"solved": layer}, rate_hz=RATE_HZ,
        options=Options(subject=SubjectOptions(static=static)),
    )  # fmt: skip
    path.mkdir()
    posefuse.write(result, path / "reconstruction.nc")
    return result
