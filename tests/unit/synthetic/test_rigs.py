"""Simulated camera rigs."""

import numpy as np
import pytest

from posefuse.errors import OptionsError
from posefuse.synthetic.options import MOST_CAMERAS
from posefuse.synthetic.rigs import build_rig


class TestRigs:
    @pytest.mark.parametrize("layout", ["ring", "corners", "aisle"])
    @pytest.mark.parametrize("n", [1, 2, 3, 5, 8, MOST_CAMERAS])
    def test_every_camera_shows_the_center(self, layout, n):
        rig = build_rig(layout, n)
        assert len(rig) == n
        np.testing.assert_allclose(rig.project(np.array([0, 0, 0.9])), [[959.5, 539.5]] * n, atol=1e-9)
        centers = np.array([camera.center_m for camera in rig.cameras])
        assert (centers[:, 2] > 0.5).all()
        apart = np.linalg.norm(centers[:, None] - centers[None], axis=-1) + np.eye(n) * 9
        assert apart.min() > 0.1

    @pytest.mark.parametrize("n", [0, MOST_CAMERAS + 1])
    def test_values_out_of_range_are_refused(self, n):
        with pytest.raises(OptionsError, match=f"1 to {MOST_CAMERAS} cameras, got {n}"):
            build_rig("ring", n)

    def test_cameras_stand_upright(self):
        for camera in build_rig("ring", 5).cameras:
            top, bottom = camera.project(np.array([[0, 0, 1.7], [0, 0, 0.1]]))[0]
            assert top[1] < bottom[1]
