"""Poses of a moving board also move the corners that are seen between them."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.board_coverage import BoardOptions, run

from posefuse.calibration.boards.calibration import calibrate_board
from posefuse.calibration.boards.model import Motion
from posefuse.calibration.boards.motion_curvature import motion_curvature, pose_weights
from posefuse.calibration.boards.shape import N_SHAPE
from posefuse.calibration.boards.shaped_model import ShapedModel, with_free_shape
from posefuse.calibration.normal_equations import NormalEquations, shared_columns
from tests.boards import BOARD, SIZE_PX, board_detections, board_rig, unplaced


@pytest.fixture(scope="module")
def solution():
    rig = board_rig()
    detections = board_detections(rig, offset_s=(0.0, 0.04, -0.03), n_frames=20)
    return calibrate_board(detections, BOARD, dict.fromkeys(rig.names, SIZE_PX), intrinsics=unplaced(rig)).solution


@pytest.mark.parametrize("pose", [0, 1, 7, -1])
def test_weights_are_those_of_finite_differences(solution, pose):
    model = solution.model
    rows, (weights, poses) = model.rows(solution.scale), pose_weights(model)
    moved = []
    for sign in (1e-6, -1e-6):
        origins = model.origins_m.copy()
        origins[pose, 0] += sign
        motion = Motion.of(model.rotations, origins, model.observations.time_s)
        moved.append(replace(model, origins_m=origins, motion=motion).rows(solution.scale).residual)
    weight = (weights * (poses == pose % len(model.origins_m))).sum(axis=1)[:, None]
    assert (moved[0] - moved[1]) / 2e-6 == pytest.approx(weight * rows.by_point[:, :, 3], rel=1e-4, abs=0.1)


def test_it_is_the_curvature_without_motion(solution):
    still = replace(solution.model, motion=Motion.zero(len(solution.model.rotations)))
    free = with_free_shape(solution.free)
    found = motion_curvature(ShapedModel(still), solution.scale, free)
    rows = replace(ShapedModel(still).rows(solution.scale), prior=None)
    normal = NormalEquations.of(rows, still.observations, len(free), rows.curvature)
    shared = shared_columns(free, N_SHAPE)
    expected = shared.T @ normal.reduced(np.flatnonzero(free.ravel())).matrix @ shared
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_stated_variances_of_lenses_and_poses_hold_for_cameras_that_are_not_synchronized():
    """With a motion that is held fixed, squared errors of the rotations were 12 times the variance."""
    found = run(BoardOptions("corner", 5, "charuco", 94, False, 0.04, 0.3667, "white", 109))["nees"]
    assert np.mean(found["rotation"]) < 3.0
    assert np.mean(found["center"]) < 3.0
