"""People of a result: joint angles and OpenSim have the same ones, with and without a static trial."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posefuse
from posefuse.biomechanics.marker_model import MarkerModel, marker_model
from posefuse.io.results.axes import y_up_from_world
from posefuse.model.joint_angles import OPENSIM
from posefuse.model.options.options import Options
from posefuse.model.options.subject import SubjectOptions
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.joint_angles import with_joint_angles
from posefuse.pipeline.opensim_person import opensim_person
from posefuse.pipeline.subjects import fit_subjects, frame_rate
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.figures import model_layer
from tests.scenes import ring

FRAMES, STANDING, RATE_HZ = 40, 15, 60.0
SIZES = {"anna": 0.95, "ben": 1.08}


def markers(model: MarkerModel, size: float, offset_m: np.ndarray) -> np.ndarray:
    """Return keypoints of a person who stands and then bends legs and arms, shape (frame, keypoint, 3), y up."""
    at = model.anatomy.coordinate_index
    amount = np.clip((np.arange(FRAMES) - STANDING) / (FRAMES - STANDING), 0.0, 1.0)
    coordinates = np.zeros((FRAMES, len(model.anatomy.coordinates)))
    coordinates[:, at("pelvis_ty")] = 0.93
    for name, most_deg in {"hip_flexion": 60.0, "knee_angle": 70.0, "ankle_angle": 15.0, "elbow_flex": 80.0}.items():
        for side in "rl":
            coordinates[:, at(f"{name}_{side}")] = np.radians(most_deg) * amount
    places = model.markers.locations_m + offset_m
    return model.anatomy.marker_positions(size * model.anatomy.unscaled(), coordinates, model.markers.bodies, places)


def people(static: str | None) -> Reconstruction:
    """Return a result of two people of different sizes, whose keypoints deviate from their average places."""
    skeleton = shipped_skeleton("halpe_26")
    model, rig, rng = marker_model(skeleton), ring(3), np.random.default_rng(0)
    assert model is not None
    points = np.full((FRAMES, len(SIZES), len(skeleton), 3), np.nan)
    for p, size in enumerate(SIZES.values()):
        shifted = markers(model, size, model.sd_m * rng.standard_normal(model.sd_m.shape))
        shifted[..., 2] += 1.5 * p
        points[:, p, model.columns] = shifted @ y_up_from_world(rig.up_axis)
    layer = model_layer(points)
    covariance = np.zeros(layer.covariance_m2.shape)
    covariance[..., [0, 3, 5]] = 0.005**2
    layer = replace(layer, covariance_m2=np.where(np.isfinite(points[..., :1]), covariance, np.nan))
    return Reconstruction(
        rig=rig, skeleton=skeleton, person_ids=tuple(SIZES), frame_numbers=np.arange(FRAMES),
        time_s=np.arange(FRAMES) / RATE_HZ, layers={"solved": layer}, rate_hz=RATE_HZ,
        options=Options(subject=SubjectOptions(static=static)),
    )  # fmt: skip


def joint_coordinates(result: Reconstruction) -> np.ndarray:
    """Return the coordinates of joints that ``posefuse opensim`` has, shape (frame, person, coordinate), degrees."""
    model = marker_model(result.skeleton)
    assert model is not None
    layer = result.layers["solved"]
    subjects = fit_subjects(result, model, layer)
    found = [opensim_person(result, layer, p, subjects) for p in range(len(result.person_ids))]
    columns = [model.anatomy.coordinate_index(name) for name in JOINTS]
    return np.stack([person.degrees[:, columns] for person in found if person is not None], axis=1)


JOINTS = ("hip_flexion_r", "knee_angle_l", "ankle_angle_r", "subtalar_angle_l", "lumbar_extension", "arm_flex_r")


@pytest.mark.parametrize("static", [None, f"0:{STANDING}", "another result"])
def test_opensim_has_the_angles_of_the_result(static, tmp_path: Path):
    if static == "another result":
        path = tmp_path / "standing.nc"
        posefuse.write(people(None).frames(0, STANDING), path)
        static = str(path)
    result = people(static)
    angles = with_joint_angles(result).joint_angles
    assert angles is not None
    ours = np.stack([angles.degrees[..., angles.index(name, OPENSIM)] for name in JOINTS], axis=-1)
    np.testing.assert_allclose(joint_coordinates(result), ours, atol=1e-3)


def test_a_static_trial_changes_every_person():
    with_trial, without = (joint_coordinates(people(static)) for static in (f"0:{STANDING}", None))
    change = np.abs(with_trial - without).max(axis=(0, 2))
    assert change.shape == (2,)
    assert (change > 0.1).all()


def test_people_have_their_own_sizes_and_verticals():
    result = people(None)
    model = marker_model(result.skeleton)
    assert model is not None
    subjects = fit_subjects(result, model, result.layers["solved"])
    femur = model.anatomy.body_index("femur_r")
    found = [float(fit.model.scales[femur, 1]) for fit in subjects.fits]
    assert found == pytest.approx(list(SIZES.values()), abs=0.05)
    assert np.allclose(subjects.verticals[0], subjects.verticals[1])


def test_the_frame_rate_is_that_of_the_times_if_it_is_not_stated():
    result = people(None)
    assert frame_rate(result) == RATE_HZ
    assert frame_rate(replace(result, rate_hz=None)) == pytest.approx(RATE_HZ)
    assert frame_rate(replace(result, rate_hz=None, time_s=np.full(FRAMES, np.nan))) == 30.0
