"""Derivatives of the model of cameras and a moving board."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.boards.model import BoardModel, Motion
from posefuse.calibration.boards.observations import corner_observations
from posefuse.calibration.boards.parameters import N_PARAMETERS, LensPrior, free_lens
from posefuse.model.cameras import LensModel
from tests.boards import BOARD, RATE_HZ, board_detections, board_poses, board_rig


def model_of(lens: LensModel, n_frames: int = 8) -> BoardModel:
    rig = board_rig(2, lens)
    corners = corner_observations(board_detections(rig, n_frames=n_frames), BOARD)
    rotations, origins = board_poses(corners.frame / RATE_HZ)
    priors = tuple(LensPrior.of(camera) for camera in rig.cameras)
    return BoardModel.at_rest(rig, rotations, origins, BOARD, corners, priors)


@pytest.mark.parametrize("lens", [LensModel.BROWN, LensModel.RATIONAL, LensModel.FISHEYE])
def test_derivatives_match_finite_differences(lens):
    model = replace(model_of(lens).moving(), offset_s=np.array([0.0, 0.03]))
    rows, scale = model.rows(np.ones(2)), np.ones(2)
    still = np.zeros((2, N_PARAMETERS)), np.zeros((len(model.rotations), 6))
    free = free_lens(model.rig.cameras[0]) | (np.arange(N_PARAMETERS) < 6) | (np.arange(N_PARAMETERS) == 18)
    for k in np.flatnonzero(free):
        change = still[0].copy()
        change[:, k] = step = 1e-4 if 6 <= k < 10 else 1e-6
        up, down = (model.moved(sign * change, still[1]).rows(scale).residual for sign in (1, -1))
        assert (up - down) / (2 * step) == pytest.approx(rows.by_camera[:, :, k], rel=1e-4, abs=2e-2)


def test_derivatives_by_poses_match_finite_differences():
    model = model_of(LensModel.BROWN)
    rows, scale = model.rows(np.ones(2)), np.ones(2)
    for k in range(6):
        step = np.zeros((len(model.rotations), 6))
        step[:, k] = 1e-6
        zero = np.zeros((2, N_PARAMETERS))
        up, down = (model.moved(zero, sign * step).rows(scale).residual for sign in (1, -1))
        assert (up - down) / 2e-6 == pytest.approx(rows.by_point[:, :, k], rel=1e-4, abs=2e-2)


def test_motion_is_that_of_a_parabola(rng):
    time_s = np.array([0.0, 0.1, 0.25, 0.3])
    velocity, acceleration = rng.normal(size=3), rng.normal(size=3)
    origins = time_s[:, None] * velocity + 0.5 * time_s[:, None] ** 2 * acceleration
    motion = Motion.of(np.repeat(np.eye(3)[None], 4, axis=0), origins, time_s)
    assert motion.acceleration[1:-1] == pytest.approx(np.repeat(acceleration[None], 2, axis=0))
    assert motion.velocity[1] == pytest.approx(velocity + 0.1 * acceleration)
    assert motion.velocity[0] == pytest.approx(velocity)


def test_images_belong_to_the_closest_pose():
    model = model_of(LensModel.BROWN)
    shifted, used = model.observations.closest(np.array([0.0, 1.0 / RATE_HZ]))
    second = shifted.view == 1
    # The first view alone shows the first pose, and both images of the last pose are at most a period apart.
    assert used.all()
    assert set(shifted.point[second]) == set(range(1, 8))
    assert np.abs(shifted.delay_s + np.array([0.0, 0.1])[shifted.view])[shifted.point < 7].max() < 1e-9
    assert np.all(np.diff(shifted.point) >= 0)


def test_poses_are_at_the_mean_time_of_their_images_and_leave_out_those_without():
    model = model_of(LensModel.BROWN)
    seen = model.observations
    # The first view does not see the first pose, whose only image is closer to the second one.
    rows = (seen.view == 1) | (seen.point > 0)
    late_s = np.array([0.0, 0.08])
    shifted, used = seen._rows(rows).closest(late_s)
    assert used.tolist() == [False] + [True] * 7
    lag_s = shifted.delay_s + late_s[shifted.view]
    means = np.bincount(shifted.point, lag_s) / np.bincount(shifted.point)
    assert np.abs(means).max() < 1e-12
    moving = replace(model, observations=seen._rows(rows), offset_s=late_s).moving()
    assert len(moving.rotations) == len(moving.origins_m) == moving.observations.n_points == 7
