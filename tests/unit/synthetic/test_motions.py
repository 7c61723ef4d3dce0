"""Simulated motion."""

import numpy as np
import pytest

from posefuse.errors import OptionsError
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import CreatureMotion, HumanMotion
from posefuse.synthetic.options import ACTIVITIES, SceneOptions
from posefuse.synthetic.scenes import simulate

MOUSE = """
name = "mouse"
keypoints = ["snout", "left_ear", "right_ear", "back", "tail", "lone"]
edges = [["snout", "left_ear"], ["snout", "right_ear"], ["snout", "back"], ["back", "tail"]]
"""


class TestMotion:
    @pytest.fixture(scope="class")
    @classmethod
    def motion(cls):
        motion = HumanMotion.random(ACTIVITIES, np.random.default_rng(3))
        figure = human(1.7)
        times = np.arange(0, 18, 1 / 120)
        return figure, motion, times, motion.positions(figure, times)

    def test_bones_keep_their_length(self, motion):
        figure, _, _, positions = motion
        parents = np.array(figure.parents)
        lengths = np.linalg.norm(positions[:, 1:] - positions[:, parents[1:]], axis=-1)
        assert np.ptp(lengths, axis=0).max() < 1e-12

    def test_left_and_right_are_symmetric(self, motion):
        figure = motion[0]
        for name, offset in zip(figure.names, figure.offsets_m, strict=True):
            if name.startswith("left_"):
                other = figure.offsets_m[figure.names.index(f"right_{name[5:]}")]
                np.testing.assert_allclose(offset, other * [1, -1, 1])

    def test_motion_is_smooth_and_human(self, motion):
        figure, _, times, positions = motion
        step = times[1] - times[0]
        body = [figure.names.index(name) for name in ("mid_hip", "nose", "left_wrist", "right_ankle")]
        velocity = np.diff(positions[:, body], axis=0) / step
        acceleration = np.diff(velocity, axis=0) / step
        assert np.linalg.norm(velocity, axis=-1).max() < 8.0
        assert np.linalg.norm(acceleration, axis=-1).max() < 80.0
        assert np.linalg.norm(np.diff(acceleration, axis=0), axis=-1).max() < 30.0

    def test_feet_are_on_the_floor_except_in_jumps(self, motion):
        figure, person, times, positions = motion
        feet = [figure.names.index(f"{side}_{part}") for side in ("left", "right") for part in ("heel", "big_toe")]
        lowest = positions[:, feet, 2].min(axis=1)
        activity = np.array(person.activities)[(times / person.activity_s).astype(int) % len(person.activities)]
        assert np.abs(lowest[activity != "jump"]).max() < 0.03
        assert lowest[activity == "jump"].max() > 0.15
        assert positions[..., 2].min() > -0.03

    def test_walking_person_moves(self):
        person = HumanMotion.random(("walk",), np.random.default_rng(0))
        hips = person.positions(human(), np.arange(0, 4, 0.01))[:, 0]
        speed = np.linalg.norm(np.diff(hips[:, :2], axis=0), axis=1) / 0.01
        assert np.median(speed) == pytest.approx(person.cadence_hz * person.stride_m, rel=0.05)

    def test_positions_are_independent_of_the_order_of_times(self, motion):
        figure, person, times, positions = motion
        chosen = np.array([1700, 3, 900])
        np.testing.assert_allclose(person.positions(figure, times[chosen]), positions[chosen], atol=1e-4)

    def test_unknown_activities_are_refused(self):
        with pytest.raises(OptionsError, match="got the element 'dance'"):
            SceneOptions(activities=("dance",))  # type: ignore[arg-type]

    def test_creatures_have_constant_bone_lengths(self, tmp_path):
        (tmp_path / "mouse.toml").write_text(MOUSE)
        scene = simulate(SceneOptions(skeleton=str(tmp_path / "mouse.toml"), duration_s=2))
        points = scene.truth.layers["measured"].points_m[:, 0]
        edges = scene.truth.skeleton.edge_indices
        lengths = np.linalg.norm(points[:, edges[:, 0]] - points[:, edges[:, 1]], axis=-1)
        assert np.ptp(lengths, axis=0).max() < 1e-12
        assert lengths.min() > 0.02
        assert isinstance(CreatureMotion(0, 0.3), CreatureMotion)
