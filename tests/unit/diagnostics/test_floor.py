"""Findings about the floor."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.diagnostics.floor import floor_findings
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.scenes import ring


@pytest.fixture(scope="module")
def walker():
    """Simulate a person who walks for 6 s on a floor at z = 0."""
    return simulate(SceneOptions(duration_s=6, cameras=4, detector=CLEAN))


@pytest.fixture(scope="module")
def true_points(walker):
    return np.asarray(walker.truth.layers["model" if "model" in walker.truth.layers else "measured"].points_m)


class TestFindings:
    def test_no_findings_for_a_correct_world(self, walker, true_points):
        assert floor_findings([true_points], walker.truth.skeleton, walker.rig) == (None,)

    def test_upside_down_people_are_reported(self, walker, true_points):
        rig = replace(walker.rig, up_axis="-z")
        (finding,) = floor_findings([true_points], walker.truth.skeleton, rig)
        assert "upside down" in finding
        assert "`up='z'`" in finding

    def test_camera_below_the_floor_is_reported(self, walker, true_points):
        pose = walker.rig.cameras[0].camera_from_world.copy()
        low = pose.copy()
        low[:3, 3] = -pose[:3, :3] @ np.array([4.0, 0.0, -1.5])
        rig = replace(
            walker.rig, cameras=(replace(walker.rig.cameras[0], camera_from_world=low), *walker.rig.cameras[1:])
        )
        (finding,) = floor_findings([true_points], walker.truth.skeleton, rig)
        assert "cam_0 is below" in finding

    def test_no_findings_without_an_up_axis(self, true_points, walker):
        assert floor_findings([true_points], walker.truth.skeleton, replace(ring(), up_axis=None)) == (None,)
