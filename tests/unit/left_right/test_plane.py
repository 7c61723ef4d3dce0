"""The method plane."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.errors import OptionsError, PosefuseWarning
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import HumanMotion

from .conftest import Scene, assign, exchange_points, replace_pairs, simulate_walk


class TestPlane:
    DIRECTIONS = ("+x", "-x", "+y", "-y", "1,1,0")

    def walker(self, facing: str, share: float = 0.0) -> Scene:
        """Return a figure on a treadmill with a facing direction."""
        heading = {"+x": 0.0, "+y": 90.0, "-x": 180.0, "-y": -90.0, "1,1,0": 45.0}[facing]
        data = simulate_walk(share=share, seconds=2.0)
        figure, times = human(1.75), data.given.time_s
        motion = HumanMotion.random(("walk",), np.random.default_rng(0))
        motion = replace(motion, stride_m=0.0, heading=np.radians(heading))
        truth = motion.positions(figure, times)[:, figure.columns(data.given.skeleton)]
        # The heading is where the figure faces: shoulders to nose points there.
        ahead = (truth[:, 0] - truth[:, [5, 6]].mean(axis=1)).mean(axis=0)
        assert ahead[:2] @ [np.cos(motion.heading), np.sin(motion.heading)] > 0.05
        columns = data.given.skeleton.pair_indices
        return replace(data, given=replace_pairs(data.given, points_m=truth[:, columns]), truth_m=truth[:, columns])

    @pytest.mark.parametrize("facing", DIRECTIONS)
    def test_all_facing_directions(self, facing, rng):
        data = self.walker(facing)
        which = rng.random((data.given.n_frames, 8)) < 0.5
        data = replace(data, given=exchange_points(data.given, which))
        trunk = [2, 5]
        assert not data.wrong(assign(data.given, "plane", facing=facing))[:, trunk].any()

    def test_opposite_facing_mirrors(self):
        data = self.walker("+x")
        one, other = (assign(data.given, "plane", facing=facing).flipped for facing in ("+x", "-x"))
        np.testing.assert_array_equal(one, ~other)

    def test_other_up_axis(self):
        data = self.walker("+x")
        # x, y, z become z, x, y: +x becomes +z, and the up axis z becomes y.
        y_up = replace_pairs(
            replace(data.given, rig=replace(data.given.rig, up_axis="y")),
            points_m=data.given.pairs.points_m[..., [1, 2, 0]],
        )
        one, other = assign(data.given, "plane", facing="+x"), assign(y_up, "plane", facing="+z")
        np.testing.assert_array_equal(one.flipped, other.flipped)

    def test_twisted_bodies_cause_one_warning(self):
        data = self.walker("+x")
        points = np.array(data.given.pairs.points_m)
        turn = Rotation.from_euler("z", 70, degrees=True).as_matrix()
        middle = points[:, 2].mean(axis=1, keepdims=True)
        points[:, 2] = (points[:, 2] - middle) @ turn.T + middle
        with pytest.warns(PosefuseWarning, match="more than 45 degrees") as warnings:
            assign(replace_pairs(data.given, points_m=points), "plane")
        assert len(warnings) == 1

    def test_up_must_be_known_and_facing_horizontal(self):
        data = self.walker("+x")
        with pytest.raises(OptionsError, match="needs the up axis"):
            assign(replace(data.given, rig=replace(data.given.rig, up_axis=None)), "plane")
        with pytest.raises(OptionsError, match="'\\+z', which is vertical"):
            assign(data.given, "plane", facing="+z")
