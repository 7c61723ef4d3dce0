"""Continuous twists: equal to those of a frame where observed, and without jumps elsewhere."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.kinematics.continuous_twist import reach_frames, smooth_rotations
from posefuse.kinematics.twist import full_rotations
from posefuse.skeleton.skeletons import shipped_skeleton

TREE = shipped_skeleton("coco_17").tree
STEP_S = 0.02
ARM, FOREARM = TREE.bones.index("left_elbow"), TREE.bones.index("left_wrist")


def standing(frames: int) -> tuple[np.ndarray, np.ndarray]:
    turns = np.tile(np.eye(3), (frames, len(TREE.segments), 1, 1))
    return turns, np.tile(TREE.rest, (frames, 1, 1))


def test_bent_limb_in_a_constant_plane_has_the_twist_of_single_frames():
    turns, ways = standing(50)
    ways[:, FOREARM] = [np.sin(1.2), 0.0, -np.cos(1.2)]
    actual = smooth_rotations(TREE, turns, ways, STEP_S)
    expected, _ = full_rotations(TREE, turns, ways)
    np.testing.assert_allclose(actual[:, ARM], expected[:, ARM], atol=1e-12)
    np.testing.assert_allclose(actual[:, FOREARM], expected[:, FOREARM], atol=1e-12)


def test_third_axes_are_along_the_bones():
    rng = np.random.default_rng(1)
    turns, ways = standing(20)
    ways = rng.standard_normal(ways.shape)
    ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
    actual = smooth_rotations(TREE, turns, ways, STEP_S)
    np.testing.assert_allclose(actual[..., 2], ways, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(actual), 1.0, atol=1e-12)


def test_straightened_limb_changes_its_bending_plane_smoothly():
    frames = 60
    turns, ways = standing(frames)
    bend = np.radians(60.0) * np.abs(np.cos(np.linspace(0.0, np.pi, frames)))
    plane = np.where(np.arange(frames) < frames // 2, np.radians(40.0), np.radians(-40.0))
    ways[:, FOREARM] = np.stack([np.sin(bend) * np.cos(plane), np.sin(bend) * np.sin(plane), -np.cos(bend)], axis=-1)

    def fastest_deg(frames_of: np.ndarray) -> float:
        arm = Rotation.from_matrix(frames_of[:, ARM])
        return float(np.degrees((arm[1:] * arm[:-1].inv()).magnitude().max()))

    by_itself, steady = full_rotations(TREE, turns, ways)[0], smooth_rotations(TREE, turns, ways, STEP_S)
    assert fastest_deg(by_itself) > 10.0
    assert fastest_deg(steady) < 0.5 * fastest_deg(by_itself)


@pytest.mark.parametrize("name", ["coco_17", "fly_38"])
def test_distant_frames_have_no_influence(name):
    tree = shipped_skeleton(name).tree
    rng = np.random.default_rng(2)
    reach = reach_frames(tree, 0.1)
    frames = 2 * reach + 11
    turns = Rotation.random(frames * len(tree.segments), random_state=rng).as_matrix().reshape(frames, -1, 3, 3)
    ways = rng.standard_normal((frames, len(tree.bones), 3))
    ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
    whole = smooth_rotations(tree, turns, ways, 0.1)
    cut = smooth_rotations(tree, turns[5:-5], ways[5:-5], 0.1)
    np.testing.assert_allclose(cut[reach], whole[5 + reach], atol=1e-12)


def test_frames_without_a_body_have_no_influence():
    turns, ways = standing(40)
    ways[:, FOREARM] = [np.sin(1.0), 0.0, -np.cos(1.0)]
    expected = smooth_rotations(TREE, turns, ways, STEP_S)
    turns[15:20], ways[15:20] = np.nan, np.nan
    actual = smooth_rotations(TREE, turns, ways, STEP_S)
    assert np.isnan(actual[15:20]).all()
    np.testing.assert_allclose(np.delete(actual, range(15, 20), 0), np.delete(expected, range(15, 20), 0), atol=1e-12)
