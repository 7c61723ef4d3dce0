"""Errors in frames that the cameras were not calibrated with."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.boards.calibration import calibrate_board
from tests.boards import BOARD, SIZE_PX, board_detections, board_rig, unplaced


def solve(n_frames):
    rig = board_rig()
    detections, sizes = board_detections(rig, n_frames=n_frames), dict.fromkeys(rig.names, SIZE_PX)
    return calibrate_board(detections, BOARD, sizes, intrinsics=unplaced(rig))


def test_held_out_error_is_that_of_the_noise():
    result = solve(60)
    assert result.held_out.n_frames == 60
    assert result.held_out.rms_px == pytest.approx(0.2 * np.sqrt(2), rel=0.05)
    assert result.held_out.by_view_px == pytest.approx(0.2 * np.sqrt(2), rel=0.15)
    assert result.cameras[1].held_out_px == result.held_out.by_view_px[1]


def test_wrong_lens_increases_it():
    rig = board_rig()
    wrong = {
        name: replace(c, matrix=c.matrix * [[1.05, 1, 1], [1, 1.05, 1], [1, 1, 1]]) for name, c in unplaced(rig).items()
    }
    sizes = dict.fromkeys(rig.names, SIZE_PX)
    result = calibrate_board(board_detections(rig), BOARD, sizes, intrinsics=wrong)
    assert result.held_out.rms_px > 1.3 * 0.2 * np.sqrt(2)


def test_few_frames_are_not_held_out():
    result = solve(8)
    assert result.held_out.n_frames == 0
    assert np.isnan(result.held_out.rms_px)
