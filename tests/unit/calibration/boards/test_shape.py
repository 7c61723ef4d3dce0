"""The shape of a bent and stretched board is found together with the cameras."""

from dataclasses import replace

import numpy as np
from benchmarks.board_coverage import BENT_M, SIZE_PX, BoardOptions, errors, simulate_board

from posefuse.calibration.boards.calibration import calibrate_board
from posefuse.calibration.boards.shape import shape_directions, shape_precision


def calibrated(kind, seed):
    case = simulate_board(BoardOptions("corner", 3, "charuco", 60, True, 0.0, 0.1, kind, seed))
    given = {camera.name: replace(camera, camera_from_world=np.eye(4)) for camera in case.rig.cameras}
    return case, calibrate_board(case.detections, case.board, dict.fromkeys(case.rig.names, SIZE_PX), intrinsics=given)


def test_bent_board_moves_no_camera():
    _, flat = calibrated("white", 1)
    case, bent = calibrated("bent", 1)
    assert np.abs(flat.solution.model.shape[:3]).max() < 0.1 * BENT_M
    assert np.abs(bent.solution.model.shape[:3]).max() > 0.2 * BENT_M
    # The noise is the same, and so are the errors.
    moved = errors(case, bent)[:, 3:6] - errors(*calibrated("white", 1))[:, 3:6]
    assert np.abs(moved).max() < 1e-4


def test_shape_is_neither_a_motion_nor_a_scale():
    case = simulate_board(BoardOptions("corner", 2, "checkerboard", 15, True, 0.0, 0.1, "white", 0))
    points = case.board.points_m - case.board.points_m.mean(axis=0)
    directions = shape_directions(case.board)
    assert directions.shape == (len(points), 3, len(shape_precision(case.board)))
    # Stretching keeps the area, to first order.
    for k in (3, 4):
        rate = np.linalg.lstsq(points[:, :2], directions[:, :2, k], rcond=None)[0]
        assert abs(np.trace(rate)) < 1e-12
        assert abs(rate[0, 1] - rate[1, 0]) < 1e-12
