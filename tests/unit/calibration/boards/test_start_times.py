"""Videos of a board that start up to some seconds apart are aligned by its motion."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.boards.calibration import calibrate_board
from tests.boards import BOARD, SIZE_PX, board_detections, board_rig, unplaced


def calibrated(offset_s, n_frames=150, **more):
    rig = board_rig()
    detections = board_detections(rig, n_frames=n_frames, offset_s=offset_s)
    sizes: dict[str, tuple[int, int]] = dict.fromkeys(rig.names, SIZE_PX)
    return calibrate_board(detections, BOARD, sizes, intrinsics=unplaced(rig), **more)


@pytest.mark.parametrize("offset_s", [(0.0, 3.27, -1.9), (0.0, -7.44, 0.0), (0.0, 0.0, 4.0)])
def test_seconds_are_found(offset_s):
    result = calibrated(offset_s, clocks="independent")
    assert [report.offset_s for report in result.cameras] == pytest.approx(offset_s, abs=0.01)
    assert result.error_px < 0.4
    assert any("did not start together" in note for note in result.notes)


def test_synchronized_views_stay():
    one = calibrated((0.0, 0.03, 0.0), clocks="independent")
    other = calibrated((0.0, 0.03, 0.0))
    assert one.notes == ()
    assert one.error_px == other.error_px


def test_board_that_rests_gives_no_lag():
    """Every lag explains a board that does not move."""
    rig = board_rig()
    moving = board_detections(rig, n_frames=60)
    pixels = np.repeat(moving.dense()[0][:1], 60, axis=0) + np.random.default_rng(0).normal(0, 0.1, (60, 3, 20, 2))
    resting = replace(moving.from_dense(BOARD.skeleton, rig.names, pixels, rate_hz=10.0))
    sizes: dict[str, tuple[int, int]] = dict.fromkeys(rig.names, SIZE_PX)
    result = calibrate_board(resting, BOARD, sizes, intrinsics=unplaced(rig), clocks="independent")
    assert result.notes == ()
