"""Poses and focal lengths from homographies are exact without noise."""

import numpy as np
import pytest

from posefuse.calibration.boards.plane_pose import focal_px, homography, pose_of_plane
from posefuse.model.cameras import Camera
from tests.boards import BOARD, board_poses, board_rig


@pytest.mark.parametrize("view", [0, 1, 2])
def test_pose_is_exact(view):
    camera = board_rig().cameras[view]
    rotations, origins = board_poses(np.linspace(0.0, 5.0, 6))
    for rotation, origin in zip(rotations, origins, strict=True):
        pixels = camera.project(BOARD.points_m @ rotation.T + origin)[0]
        found = pose_of_plane(camera, BOARD.points_m[:, :2], pixels)
        assert found is not None
        assert found[0] == pytest.approx(camera.rotation @ rotation, abs=1e-8)
        assert found[1] == pytest.approx(camera.rotation @ origin + camera.translation_m, abs=1e-8)


def test_focal_length_is_exact():
    matrix = np.array([[900.0, 0.0, 600.0], [0.0, 900.0, 350.0], [0.0, 0.0, 1.0]])
    camera = Camera("a", (1280, 720), matrix, board_rig().cameras[0].camera_from_world)
    rotations, origins = board_poses(np.linspace(0.0, 5.0, 6))
    found = [
        homography(BOARD.points_m[:, :2], camera.project(BOARD.points_m @ rotation.T + origin)[0])
        for rotation, origin in zip(rotations, origins, strict=True)
    ]
    assert focal_px([h for h in found if h is not None], (600.0, 350.0)) == pytest.approx(900.0)


def test_degenerate_corners_have_no_homography(rng):
    line = np.stack([np.arange(6.0), 2.0 * np.arange(6.0)], axis=1)
    assert homography(line, rng.normal(size=(6, 2))) is None or homography(line, line) is None
    assert homography(line[:3], line[:3]) is None
    assert focal_px([], (0.0, 0.0)) is None
