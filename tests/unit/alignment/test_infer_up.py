"""Inference of the up direction: the same in every world, and unknown where people or cameras do not show it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from posefuse.alignment.apply import aligned_rig
from posefuse.alignment.infer_up import describe_up, infer_up
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import CameraRig
from posefuse.model.up_axis import UP_AXES, up_vector
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton
from posefuse.synthetic.options import CLEAN, Activity, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.properties import examples

UP = np.array([0.0, 0.0, 1.0])
RATE_HZ = 60.0


def scene(activity: Activity = "walk", seed: int = 0) -> tuple[np.ndarray, Skeleton, CameraRig]:
    """Return true points of a person in a world with z up, and its cameras without an up axis."""
    options = SceneOptions(duration_s=3, cameras=4, detector=CLEAN, activities=(activity,), seed=seed, rate_hz=RATE_HZ)
    made = simulate(options)
    truth = made.truth.layers["model" if "model" in made.truth.layers else "measured"]
    return np.asarray(truth.points_m), made.truth.skeleton, made.rig.with_up(None)


WALK = scene()


def turned(points: np.ndarray, rig: CameraRig, rotation: np.ndarray, shift: np.ndarray) -> tuple[np.ndarray, CameraRig]:
    """Return the same scene in another world."""
    alignment = Alignment(rotation, shift)
    return alignment.points(points), aligned_rig(rig, alignment)


def angle_deg(direction: tuple[float, float, float], other: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(np.dot(direction, other), -1, 1))))


@pytest.mark.parametrize("activity", ["walk", "turn", "reach", "stand", "jump"])
@pytest.mark.parametrize("seed", range(3))
def test_upright_people_show_up(activity, seed):
    points, skeleton, rig = scene(activity, seed)
    up, reason = infer_up([points], skeleton, rig, RATE_HZ)
    assert up is not None, reason
    assert up.axis == "z"
    assert angle_deg(up.direction, UP) < 2.0 * up.sd_deg


@given(seed=st.integers(0, 2**31 - 1), noise_m=st.floats(0.0, 0.03))
@examples(25)
def test_direction_turns_with_the_world(seed, noise_m):
    points, skeleton, rig = WALK
    rng = np.random.default_rng(seed)
    points = points + rng.normal(0.0, noise_m, points.shape)
    rotation = Rotation.random(random_state=seed).as_matrix()
    here, reason = infer_up([points], skeleton, rig, RATE_HZ)
    moved, moved_rig = turned(points, rig, rotation, rng.normal(0.0, 10.0, 3))
    there, moved_reason = infer_up([moved], skeleton, moved_rig, RATE_HZ)
    assert here is not None
    assert there is not None
    assert moved_reason == reason
    np.testing.assert_allclose(there.direction, rotation @ here.direction, atol=1e-6)
    assert there.sd_deg == pytest.approx(here.sd_deg, rel=1e-6)
    assert angle_deg(there.direction, rotation @ UP) < 2.0 * there.sd_deg


@pytest.mark.parametrize("axis", UP_AXES)
def test_nearest_axis_is_named_within_its_limit(axis):
    points, skeleton, rig = WALK
    to_axis = Rotation.align_vectors([up_vector(axis)], [UP])[0]
    for tilt_deg, expected in ((20.0, axis), (44.0, None)):
        tilt = Rotation.from_rotvec(np.radians(tilt_deg) * np.roll(up_vector(axis), 1))
        moved, moved_rig = turned(points, rig, (tilt * to_axis).as_matrix(), UP)
        up, reason = infer_up([moved], skeleton, moved_rig, RATE_HZ)
        assert up is not None
        assert up.axis == expected
        assert ("exports are not rotated" in describe_up(up, reason)) == (expected is None)


@given(seed=st.integers(0, 2**31 - 1))
@examples(25)
def test_people_who_do_not_stand_leave_up_unknown(seed):
    """They lie or stand on their hands, before level cameras: their bodies are turned by 60 degrees or more."""
    points, skeleton, rig = WALK
    rng = np.random.default_rng(seed)
    across = np.append(rng.normal(size=2), 0.0)
    turn = Rotation.from_rotvec(np.radians(rng.uniform(60.0, 180.0)) * across / np.linalg.norm(across)).as_matrix()
    up, reason = infer_up([points @ turn.T], skeleton, rig, RATE_HZ)
    assert up is None
    assert "neither the cameras nor the feet" in reason


def test_person_at_rest_before_cameras_on_one_side_leaves_up_unknown():
    """Seen from one side, a person who stands looks like a person who lies, seen from above."""
    points, skeleton, rig = scene("stand")
    still = np.repeat(points[:1], 100, axis=0)
    one = rig.cameras[0]
    beside = Alignment(Rotation.from_rotvec([0.0, 0.0, 0.3]).as_matrix(), np.zeros(3))
    pair = CameraRig((one, replace(aligned_rig(CameraRig((one,)), beside).cameras[0], name="other")))
    assert infer_up([still], skeleton, pair, RATE_HZ)[0] is None
    assert infer_up([still], skeleton, rig, RATE_HZ)[0] is not None
    # The feet of a person who moves show it.
    moving, _, _ = scene("reach")
    assert infer_up([moving], skeleton, pair, RATE_HZ)[0] is not None


def test_sitting_crouching_and_unseen_feet_leave_up_unknown():
    points, skeleton, rig = WALK
    sitting = np.array(points)
    hips, knees, ankles = ([skeleton.index(f"{side}_{name}") for side in ("left", "right")] for name in
                           ("hip", "knee", "ankle"))  # fmt: skip
    sitting[:, :, knees] = sitting[:, :, hips] + np.array([0.45, 0.0, 0.0])
    sitting[:, :, ankles] = sitting[:, :, knees] + np.array([0.3, 0.0, -0.3])
    unseen = np.array(points)
    unseen[:, :, ankles] = np.nan
    for part in (sitting, unseen, np.full_like(points, np.nan), points[:5], points[:, :0]):
        up, reason = infer_up([part], skeleton, rig, RATE_HZ)
        assert up is None
        assert reason == "too few people stand upright"


def test_bodies_in_all_directions_leave_up_unknown():
    points, skeleton, rig = WALK
    turns = Rotation.random(len(points), random_state=1).as_matrix()
    up, reason = infer_up([np.einsum("fij,fpkj->fpki", turns, points)], skeleton, rig, RATE_HZ)
    assert up is None
    assert "different directions" in reason


@pytest.mark.parametrize("name", ["mouse_22", "fly_38"])
def test_animals_and_hands_leave_up_unknown(name):
    skeleton = shipped_skeleton(name)
    points = np.random.default_rng(0).normal(size=(50, 1, len(skeleton), 3))
    up, reason = infer_up([points], skeleton, WALK[2], RATE_HZ)
    assert up is None
    assert describe_up(up, reason).startswith("The up axis is unknown")
    assert "`up`" in describe_up(up, reason)
