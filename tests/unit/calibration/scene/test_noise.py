"""The standard deviation of measured places is that of their errors, whatever scale weights them."""

import pytest

from posefuse.calibration.scene.noise import PlaceNoise, place_noise
from posefuse.calibration.scene.view import KnownLens, descend, view_of
from tests.boards import board_rig


@pytest.mark.parametrize(("n_points", "n_cameras"), [(300, 1), (8, 60)])
def test_standard_deviation_of_places(rng, n_points, n_cameras):
    camera = board_rig(1).cameras[0]
    views = []
    for _ in range(n_cameras):
        points_m = rng.uniform(-0.3, 0.3, (n_points, 3))
        pixels = camera.project(points_m)[0] + rng.normal(0.0, 3.0, (n_points, 2))
        views.append(view_of(KnownLens(camera), points_m, pixels))
    noise = PlaceNoise(3.0, 3.0)
    for _ in range(4):
        noise = place_noise([descend(view, noise.scale_px) for view in views], noise.scale_px)
    assert noise.sd_px == pytest.approx(3.0, rel=0.08)
    assert noise.scale_px < 0.92 * noise.sd_px
