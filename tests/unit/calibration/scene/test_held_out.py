"""Predictions of points from the other points of a camera."""

import numpy as np
import pytest

from posefuse.calibration.scene.calibration import calibrate_by_scene
from posefuse.calibration.scene.held_out import too_few
from posefuse.model.scene_points import ScenePoints
from tests.boards import board_rig
from tests.unit.calibration.scene.test_calibration import SOLID, lenses_of, scene_of


def test_distances_of_correct_points_follow_their_law():
    """The squared Mahalanobis distance has two degrees of freedom, so its mean is 2; the noise is estimated, too."""
    rig = board_rig(1)
    squared = [
        calibrate_by_scene(lenses_of(rig), scene_of(rig, SOLID, 1.0, seed)).held_out.sds ** 2 for seed in range(40)
    ]
    assert 1.2 < np.mean(squared) < 3.0


def test_wrong_point_stands_out():
    rig = board_rig(1)
    scene = scene_of(rig, SOLID)
    pixels = {name: places.copy() for name, places in scene.pixels.items()}
    pixels[rig.names[0]][3] += 30.0
    found = calibrate_by_scene(lenses_of(rig), ScenePoints(scene.points_m, pixels, "z")).held_out
    assert np.argmax(found.sds[0]) == 3
    assert found.sds[0, 3] > 5.0
    assert found.error_px[0, 3] == pytest.approx(30.0 * np.sqrt(2.0), abs=6.0)


def test_needed_points_are_not_predicted():
    rig = board_rig(1)
    found = calibrate_by_scene(lenses_of(rig), scene_of(rig, SOLID[[0, 3, 5, 6]])).held_out
    assert np.isnan(found.error_px).all()
    assert "at least 4" in too_few(SOLID[:3])
    assert "line" in too_few(SOLID[[0]] + np.arange(5)[:, None])
