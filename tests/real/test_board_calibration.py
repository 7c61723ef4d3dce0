"""Calibration from real videos and pictures of boards."""

import numpy as np
import pytest

import posefuse
from posefuse.calibration.boards.intrinsics import estimate_intrinsics
from posefuse.calibration.boards.observations import corner_observations
from posefuse.io.board_images import find_images
from posefuse.io.board_specs import read_board_spec
from posefuse.pipeline.calibrate import as_detections, calibrate
from posefuse.pipeline.detect_board import detect_board

CALISCOPE_RMSE_PX = 1.107
CALISCOPE_SPREAD = 0.006


@pytest.fixture(scope="module")
def caliscope():
    """Calibrate the four webcams once, with the lenses of the file."""
    from tests.conftest import SHARED_DATA

    folder = SHARED_DATA / "caliscope_charuco"
    if not folder.is_dir():
        pytest.skip("real recordings are not here: no shared/data/caliscope_charuco beside the repository")
    lenses = posefuse.read_cameras(folder / "camera_array.toml")
    return calibrate(folder, folder / "charuco.toml", intrinsics=lenses)


def test_charuco_videos(caliscope):
    """Errors of all corners, also those that only one camera sees; none is rejected."""
    assert caliscope.n_corners > 1850
    assert caliscope.error_px < 0.7 * CALISCOPE_RMSE_PX
    assert abs(caliscope.distances.error) < 0.001
    assert caliscope.distances.spread < 0.4 * CALISCOPE_SPREAD


def test_one_webcam_is_late(caliscope):
    late = caliscope.cameras[1]
    assert late.offset_s == pytest.approx(-0.12, abs=0.02)
    assert late.offset_sd_s < 0.01


def test_checkerboard_pictures_give_the_lenses(shared_data):
    folder = shared_data("pose2sim_videos") / "calibration"
    truth = posefuse.read_cameras(folder / "Calib.qca.txt")
    board = read_board_spec("checkerboard:4x7,square=60mm")
    views = find_images(folder / "intrinsics")
    found = detect_board(views, board, jobs=1)
    detections = as_detections(found, board)
    corners = corner_observations(detections, board)
    assert sum(view.n_found for view in found) >= 26
    for v, view in enumerate(found):
        lens = estimate_intrinsics(view.name, view.size_px, board, corners.of_view(v))
        assert lens.held_out_px < 0.3
        focal = truth.cameras[v].matrix[[0, 1], [0, 1]]
        assert np.abs(lens.camera.matrix[[0, 1], [0, 1]] / focal - 1.0).max() < 0.01
