"""The prior of lenses: principal points are close to the centers of the images, unless the corners contradict."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.boards.calibration import calibrate_board
from posefuse.calibration.boards.parameters import PRINCIPAL, LensPrior
from posefuse.model.cameras import CameraRig
from tests.boards import BOARD, SIZE_PX, board_detections, board_rig


def center_errors_px(rig: CameraRig, **options) -> np.ndarray:
    """Distances of the calibrated principal points from the true ones."""
    sizes: dict[str, tuple[int, int]] = dict.fromkeys(rig.names, SIZE_PX)
    found = calibrate_board(board_detections(rig, **options), BOARD, sizes).rig
    centers = [np.array([camera.matrix[:2, 2] for camera in each.cameras]) for each in (found, rig)]
    return np.linalg.norm(centers[0] - centers[1], axis=1)


def moved_centers(rig: CameraRig, shift_px: tuple[float, float]) -> CameraRig:
    cameras = []
    for camera in rig.cameras:
        matrix = camera.matrix.copy()
        matrix[:2, 2] += shift_px
        cameras.append(replace(camera, matrix=matrix))
    return replace(rig, cameras=tuple(cameras))


def test_the_gradient_is_that_of_the_cost():
    prior, rng = LensPrior.of(board_rig(1).cameras[0]), np.random.default_rng(0)
    for share in (0.1, 1.0, 10.0):
        away = rng.normal(size=19) * 0.01
        away[PRINCIPAL] *= share * prior.principal_px / 0.01
        gradient = prior.matrix(away) @ away
        for k in range(6, 18):
            step = np.zeros(19)
            step[k] = 1e-5
            slope = (prior.cost(away + step) - prior.cost(away - step)) / 2e-5
            assert slope == pytest.approx(gradient[k], rel=1e-4, abs=1e-6)


def test_few_noisy_images_do_not_move_principal_points():
    rig = board_rig()
    assert center_errors_px(rig, n_frames=8, noise_px=1.0).max() < 0.02 * max(SIZE_PX)


def test_principal_points_of_cropped_videos_are_found():
    rig = moved_centers(board_rig(2), (110.0, -60.0))
    assert center_errors_px(rig, n_frames=60).max() < 15.0
