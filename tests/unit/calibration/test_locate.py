"""Cameras located without an initial pose."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.locate import locate
from tests.scenes import ring


@pytest.mark.parametrize("lens", ["pinhole", "barrel", "fisheye"])
def test_camera_is_located_despite_outliers(lens, rng):
    camera = ring(2, lens).cameras[1]
    points = rng.uniform([-1.0, -1.0, 0.3], [1.0, 1.0, 1.8], (200, 3))
    pixels = camera.project(points)[0] + rng.normal(0.0, 0.5, (200, 2))
    pixels[::4] = rng.uniform(0, 1000, (50, 2))
    actual = locate(replace(camera, camera_from_world=np.eye(4)), points, pixels)
    assert actual is not None
    assert np.linalg.norm(actual.camera.center_m - camera.center_m) < 0.02
    flat = points * [1.0, 1.0, 0.0]
    assert locate(camera, flat, camera.project(flat)[0]) is None
