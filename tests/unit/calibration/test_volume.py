"""Accuracy of points that follows from the covariance of cameras."""

import numpy as np
import pytest

from posefuse.calibration.boards.parameters import N_PARAMETERS, changed
from posefuse.calibration.volume import volume_accuracy
from posefuse.model.cameras import CameraRig
from tests.boards import board_rig

SDS = np.array([*[3e-4] * 3, *[5e-4] * 3, *[0.5] * 4, *[2e-3] * 5, 0.0, 0.0, 0.0, 0.0])
N_DRAWS = 400


def covariance(n_views, rng):
    """A covariance with correlations between cameras, without uncertainty of the first camera's pose."""
    mixing = np.eye(n_views * N_PARAMETERS) + 0.1 * rng.normal(size=(n_views * N_PARAMETERS,) * 2)
    root = np.tile(SDS, n_views)[:, None] * mixing
    root[:6] = 0.0
    return root @ root.T, root


def triangulated(rig, pixels, start):
    """Least squares by Gauss-Newton with numerical derivatives."""
    point = start.copy()
    for _ in range(4):
        steps = 1e-6 * np.eye(3)
        slopes = np.stack([(rig.project(point + s) - rig.project(point - s)).ravel() for s in steps], axis=1) / 2e-6
        point += np.linalg.lstsq(slopes, (pixels - rig.project(point)).ravel(), rcond=None)[0]
    return point


def test_sds_are_those_of_triangulation_with_drawn_cameras():
    rig, rng = board_rig(), np.random.default_rng(0)
    joint, root = covariance(3, rng)
    targets = rng.uniform(-0.2, 0.2, (500, 3))
    accuracy = volume_accuracy(rig, joint.reshape(3, N_PARAMETERS, 3, N_PARAMETERS), targets)
    corner = int(np.argmax(accuracy.sd_m))
    pixels = rig.project(accuracy.middle_m)
    middle, lengths = [], []
    ends = accuracy.middle_m + np.array([[0.0, 0.0, -0.1], [0.0, 0.0, 0.1]])
    for _ in range(N_DRAWS):
        change = (root @ rng.normal(size=len(root))).reshape(3, N_PARAMETERS)
        moved = CameraRig(tuple(changed(c, row) for c, row in zip(rig.cameras, change, strict=True)))
        middle.append(triangulated(moved, pixels, accuracy.middle_m) - accuracy.middle_m)
        a, b = (triangulated(moved, rig.project(end), end) for end in ends)
        lengths.append(np.linalg.norm(b - a) / 0.2)
    worst = np.sqrt(np.linalg.eigvalsh(np.cov(np.array(middle).T))[-1])
    assert accuracy.middle_sd_m == pytest.approx(worst, rel=0.15)
    assert accuracy.length_sd > 0.8 * np.std(lengths)
    assert 0.0 < accuracy.relative_sd_m < accuracy.sd_m[corner]


def test_common_motion_of_all_cameras_changes_no_relative_place():
    rig = board_rig()
    turn = np.array([0.02, -0.01, 0.03])
    joint = np.zeros((3, N_PARAMETERS, 3, N_PARAMETERS))
    # All cameras turn about the origin of the world: rotations in their own axes, centers on arcs.
    change = np.zeros((3, N_PARAMETERS))
    for v, camera in enumerate(rig.cameras):
        change[v, :3], change[v, 3:6] = -camera.rotation @ turn, np.cross(turn, camera.center_m)
    joint[:] = change[:, :, None, None] * change[None, None]
    accuracy = volume_accuracy(rig, joint, np.random.default_rng(1).uniform(0.1, 0.3, (100, 3)))
    assert accuracy.middle_sd_m == pytest.approx(np.linalg.norm(np.cross(turn, accuracy.middle_m)), rel=1e-3)
    assert accuracy.relative_sd_m < 1e-7
    assert accuracy.length_sd < 1e-7


def test_volume_that_one_camera_sees_has_no_accuracy():
    accuracy = volume_accuracy(CameraRig(board_rig().cameras[:1]), np.zeros((1, 19, 1, 19)), np.eye(3))
    assert np.isnan(accuracy.relative_sd_m)
    assert np.isnan(accuracy.middle_sd_m)
    assert len(accuracy.points_m) == 0
