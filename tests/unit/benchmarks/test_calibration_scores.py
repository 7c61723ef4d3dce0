"""Scores of calibrations do not depend on the world, and find the errors that were made."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.calibration_scores import in_true_world, score_calibration
from hypothesis import given
from hypothesis import strategies as st

from posefuse.model.cameras import CameraRig, rotation_from_vector
from posefuse.synthetic.rigs import build_rig

ANGLE = st.floats(-3.0, 3.0)


def moved(rig: CameraRig, vector: list[float], shift_m: list[float], scale: float) -> CameraRig:
    """The rig in another world, whose unit is ``scale`` times larger."""
    rotation = rotation_from_vector(np.array(vector))
    cameras = []
    for camera in rig.cameras:
        pose = np.eye(4)
        pose[:3, :3] = camera.rotation @ rotation.T
        pose[:3, 3] = -pose[:3, :3] @ (scale * rotation @ camera.center_m + np.array(shift_m))
        cameras.append(replace(camera, camera_from_world=pose))
    return replace(rig, cameras=tuple(cameras))


@given(
    st.integers(3, 6), st.lists(ANGLE, min_size=3, max_size=3), st.lists(ANGLE, min_size=3, max_size=3),
    st.floats(0.2, 5.0),
)  # fmt: skip
def test_true_cameras_in_another_world_have_no_error(n, vector, shift, scale):
    truth = build_rig("ring", n)
    score = score_calibration(moved(truth, vector, shift, scale), truth)
    assert score.worst_rotation_deg < 1e-5
    assert score.worst_center_m < 1e-6
    assert score.scale == pytest.approx(scale)
    assert score.worst_focal == 0.0
    back = in_true_world(moved(truth, vector, shift, scale), truth)
    for ours, theirs in zip(back.cameras, truth.cameras, strict=True):
        np.testing.assert_allclose(ours.camera_from_world, theirs.camera_from_world, atol=1e-6)


def test_planted_errors_are_found():
    truth = build_rig("ring", 5)
    turned = truth.cameras[2]
    pose = turned.camera_from_world.copy()
    pose[:3, :3] = rotation_from_vector(np.radians([0.0, 2.0, 0.0])) @ pose[:3, :3]
    pose[:3, 3] = -pose[:3, :3] @ (turned.center_m + np.array([0.0, 0.0, 0.1]))
    matrix = turned.matrix.copy()
    matrix[[0, 1], [0, 1]] *= 1.03
    cameras = list(truth.cameras)
    cameras[2] = replace(turned, camera_from_world=pose, matrix=matrix)
    late = np.array([0.0, 0.0, 0.1, 0.0, 0.0])
    score = score_calibration(cameras, truth, offset_s=late, true_offset_s=np.zeros(5), rate_hz=30.0)
    assert score.worst_rotation_deg == pytest.approx(2.0)
    assert score.rotation_deg == pytest.approx(0.0, abs=1e-5)
    assert score.worst_center_m == pytest.approx(0.1)
    assert score.worst_focal == pytest.approx(0.03)
    assert score.worst_offset_frames == pytest.approx(0.08 * 30.0)


def test_two_cameras_have_a_rotation_and_no_center():
    truth = build_rig("ring", 2)
    score = score_calibration(truth, truth)
    assert score.worst_rotation_deg < 1e-5
    assert np.isnan(score.center_m)


def test_cameras_that_are_left_out_are_not_scored():
    truth = build_rig("ring", 5)
    score = score_calibration(truth.cameras[:4], truth, offset_s=np.ones(4), true_offset_s=np.zeros(5), rate_hz=30.0)
    assert score.cameras == 4
    assert score.worst_offset_frames == 0.0
