"""Calibration by points of known position: poses within their intervals, and bad input is named."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.scene.calibration import calibrate_by_scene
from posefuse.calibration.scene.view import KnownLens
from posefuse.errors import CalibrationError
from posefuse.model.cameras import vector_from_rotation
from posefuse.model.scene_points import ScenePoints
from tests.boards import board_rig

SOLID = np.array([[x, y, z] for x in (-0.4, 0.4) for y in (-0.3, 0.3) for z in (-0.2, 0.25)])
FLAT = np.unique(SOLID * [1.0, 1.0, 0.0], axis=0)
NEARLY_FLAT = np.concatenate([FLAT, FLAT[:2] + np.array([0.0, 0.0, 0.05])])


def scene_of(rig, points_m, noise_px=0.5, seed=0):
    rng = np.random.default_rng(seed)
    pixels = {c.name: c.project(points_m)[0] + rng.normal(0.0, noise_px, (len(points_m), 2)) for c in rig.cameras}
    return ScenePoints(points_m, pixels, "z")


def lenses_of(rig):
    return tuple(KnownLens(replace(camera, camera_from_world=np.eye(4))) for camera in rig.cameras)


def errors_of(found, truth):
    """Rotation (rad) about and shift (m) along the axes of the camera, found minus true."""
    turn = vector_from_rotation(found.rotation @ truth.rotation.T)
    return np.concatenate([turn, found.rotation @ (found.center_m - truth.center_m)])


@pytest.mark.parametrize("points_m", [SOLID, FLAT, NEARLY_FLAT, SOLID[[0, 3, 5, 6]]])
def test_poses_are_found_without_noise(points_m):
    rig = board_rig()
    result = calibrate_by_scene(lenses_of(rig), scene_of(rig, points_m, noise_px=0.0))
    for found, truth in zip(result.rig.cameras, rig.cameras, strict=True):
        assert np.abs(errors_of(found, truth)).max() < 1e-6
    assert result.rig.up_axis == "z"


def test_errors_agree_with_the_covariance():
    """The mean squared normalized error of 40 trials is that of six parameters."""
    rig = board_rig(1)
    squared = []
    for seed in range(40):
        result = calibrate_by_scene(lenses_of(rig), scene_of(rig, SOLID, 1.0, seed))
        error = errors_of(result.rig.cameras[0], rig.cameras[0])
        squared.append(error @ np.linalg.solve(result.rig.covariances[0].matrix, error))
    assert 4.0 < np.mean(squared) < 9.0


def test_errors_agree_with_the_covariance_if_places_are_worse_than_expected():
    rig = board_rig(4)
    squared = []
    for seed in range(10):
        result = calibrate_by_scene(lenses_of(rig), scene_of(rig, SOLID, 3.0, seed))
        for found, truth, known in zip(result.rig.cameras, rig.cameras, result.rig.covariances, strict=True):
            error = errors_of(found, truth)
            squared.append(error @ np.linalg.solve(known.matrix, error))
    assert 4.0 < np.mean(squared) < 7.5


def test_uncertain_lens_widens_the_intervals():
    rig = board_rig(1)
    covariance = np.diag([20.0, 20.0, 10.0, 10.0, *[0.0] * 8]) ** 2
    fixed, free = (
        calibrate_by_scene((replace(lens, covariance=cov),), scene_of(rig, SOLID)).cameras[0]
        for lens in lenses_of(rig)
        for cov in (None, covariance)
    )
    assert free.rotation_sd_deg > 1.5 * fixed.rotation_sd_deg
    assert free.center_sd_m > 1.5 * fixed.center_sd_m
    assert (fixed.lens_given, free.lens_given) == (True, False)


def test_one_wrong_place_has_little_influence():
    rig = board_rig(1)
    scene = scene_of(rig, SOLID)
    spoiled = scene.pixels["cam_0"].copy()
    spoiled[3] += [60.0, -40.0]
    one = calibrate_by_scene(lenses_of(rig), scene).rig.cameras[0]
    other = calibrate_by_scene(lenses_of(rig), replace(scene, pixels={"cam_0": spoiled})).rig.cameras[0]
    assert np.abs(errors_of(other, one)).max() < 0.02


def test_cameras_with_too_few_points_are_left_out():
    rig = board_rig()
    scene = scene_of(rig, SOLID)
    few = scene.pixels["cam_1"].copy()
    few[3:] = np.nan
    line = np.concatenate([few[:2], np.full((6, 2), np.nan)])
    result = calibrate_by_scene(lenses_of(rig), replace(scene, pixels={**scene.pixels, "cam_1": few}))
    assert result.rig.names == ("cam_0", "cam_2")
    assert result.left_out == (("cam_1", "shows 3 of the points, at least 4 are needed"),)
    with pytest.raises(CalibrationError, match="No camera can be located"):
        calibrate_by_scene(lenses_of(rig), replace(scene, pixels=dict.fromkeys(rig.names, line)))


def test_points_on_a_line_are_refused():
    rig = board_rig(1)
    points_m = np.linspace([-0.3, 0.0, 0.0], [0.3, 0.1, 0.0], 6)
    with pytest.raises(CalibrationError, match="points on one line"):
        calibrate_by_scene(lenses_of(rig), scene_of(rig, points_m))


def test_exchanged_points_are_named():
    rig = board_rig(1)
    scene = scene_of(rig, SOLID)
    order = [5, 2, 7, 0, 1, 6, 3, 4]
    with pytest.raises(CalibrationError, match="agree with no pose of the camera"):
        calibrate_by_scene(lenses_of(rig), replace(scene, pixels={"cam_0": scene.pixels["cam_0"][order]}))
