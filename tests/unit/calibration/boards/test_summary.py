"""Summary of a calibration by a board."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.boards.calibration import calibrate_board
from posefuse.calibration.boards.summary import summarize_board
from tests.boards import BOARD, SIZE_PX, board_detections, board_poses, board_rig, unplaced
from tests.calibration_summaries import board_summary


def test_summary_agrees_with_the_calibration():
    summary = board_summary()
    assert summary.error_px == pytest.approx(0.2 * np.sqrt(2), rel=0.1)
    assert [camera.n_images for camera in summary.cameras] == list(np.diag(summary.shared))
    width, height = BOARD.size_m
    sides = np.linalg.norm(np.diff(summary.points_m[:, 0], axis=1), axis=2)
    assert sides == pytest.approx(np.tile([width, height, width], (len(sides), 1)))
    assert len(summary.frames) == len(summary.points_m)
    assert 0.0 < summary.volume.relative_sd_m < 1e-3


def test_poses_and_volume_are_in_the_world_of_the_origin_frame():
    rig = board_rig()
    detections = board_detections(rig)
    result = calibrate_board(
        detections, BOARD, dict.fromkeys(rig.names, SIZE_PX), intrinsics=unplaced(rig), origin_frame=10
    )
    summary = summarize_board(result)
    at = int(np.flatnonzero(summary.frames == 10)[0])
    assert summary.points_m[at, 0, 0] == pytest.approx(np.zeros(3), abs=1e-6)
    assert summary.points_m[at, 0, 1] == pytest.approx([BOARD.size_m[0], 0.0, 0.0], abs=1e-6)
    rotations, origins = board_poses(np.array([1.0]))
    world_from_board = rotations[0] @ np.diag([1.0, -1.0, -1.0])
    places = board_summary_middle(rig, result, world_from_board, origins[0])
    assert summary.volume.middle_m == pytest.approx(places, abs=0.05)


def board_summary_middle(rig, result, world_from_board, origin):
    """Middle of the volume in the simulated world, moved to the world of the board."""
    true = replace(result, rig=rig)
    middle = summarize_board(true).volume.middle_m
    return world_from_board.T @ (middle - origin)
