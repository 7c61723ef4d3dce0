"""Joint angles and twists against hand computations, and their invariances."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.kinematics.joint_angles import joint_angles
from posefuse.kinematics.twist import full_rotations
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.skeleton.trees import Tree
from posefuse.skeleton.trees_from_edges import spanning_tree

BODY = shipped_skeleton("body_20").tree
FEET = shipped_skeleton("halpe_26").tree
assert BODY is not None
assert FEET is not None
LEFT, UP = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def standing(tree: Tree) -> tuple[np.ndarray, np.ndarray]:
    return np.tile(np.eye(3), (len(tree.segments), 1, 1)), tree.rest.copy()


def posed(tree: Tree, turns: np.ndarray, directions: np.ndarray) -> dict[str, float]:
    names, angles = joint_angles(tree, turns, directions)
    return dict(zip(names, angles.tolist(), strict=True))


def down_and(forward: float, left: float) -> np.ndarray:
    """Return a unit vector that points down, turned forward and then to the left by degrees."""
    f, a = np.radians([forward, left])
    return np.array([np.sin(f) * np.cos(a), np.sin(a), -np.cos(f) * np.cos(a)])


@pytest.mark.parametrize("tree", [BODY, FEET])
def test_standing_pose_has_zero_angles(tree):
    angles = posed(tree, *standing(tree))
    assert all(abs(v) < 1e-9 for k, v in angles.items() if not k.endswith(".rotation"))
    assert all(np.isnan(v) for k, v in angles.items() if k.endswith(".rotation"))


@pytest.mark.parametrize(("side", "sign"), [("left", 1.0), ("right", -1.0)])
def test_limb_angles_match_hand_computed_values(side, sign):
    turns, directions = standing(BODY)
    directions[BODY.bones.index(f"{side}_knee")] = down_and(30.0, sign * 10.0)
    directions[BODY.bones.index(f"{side}_elbow")] = down_and(-20.0, sign * 40.0)
    angles = posed(BODY, turns, directions)
    assert angles[f"{side}_hip.flexion"] == pytest.approx(30.0)
    assert angles[f"{side}_hip.abduction"] == pytest.approx(10.0)
    assert angles[f"{side}_shoulder.flexion"] == pytest.approx(-20.0)
    assert angles[f"{side}_shoulder.abduction"] == pytest.approx(40.0)


@pytest.mark.parametrize(("end", "joint", "backward"), [("ankle", "knee", True), ("wrist", "elbow", False)])
@pytest.mark.parametrize("side", ["left", "right"])
def test_bending_in_the_sagittal_plane_is_not_twist(end, joint, backward, side):
    turns, directions = standing(BODY)
    directions[BODY.bones.index(f"{side}_{end}")] = down_and(-70.0 if backward else 70.0, 0.0)
    angles = posed(BODY, turns, directions)
    assert angles[f"{side}_{joint}.flexion"] == pytest.approx(70.0)
    assert angles[f"{side}_{'hip' if joint == 'knee' else 'shoulder'}.rotation"] == pytest.approx(0.0, abs=1e-9)
    frames, unseen = full_rotations(BODY, turns, directions)
    np.testing.assert_allclose(frames[BODY.bones.index(f"{side}_{end}")][:, 1], LEFT, atol=1e-12)
    assert not unseen[BODY.bones.index(f"{side}_{end}")]


@pytest.mark.parametrize(("side", "inwards"), [("left", -1.0), ("right", 1.0)])
def test_forearm_across_the_belly_is_internal_rotation(side, inwards):
    turns, directions = standing(BODY)
    directions[BODY.bones.index(f"{side}_wrist")] = inwards * LEFT
    assert posed(BODY, turns, directions)[f"{side}_shoulder.rotation"] == pytest.approx(90.0)


@pytest.mark.parametrize("angles", [(40.0, 0.0, 0.0), (0.0, 25.0, 0.0), (0.0, 0.0, -30.0), (20.0, 10.0, 5.0)])
def test_segment_angles_match_hand_computed_values(angles):
    turns, directions = standing(BODY)
    bend, lean, turn = angles
    turns[1] = turns[2] = Rotation.from_euler("YXZ", [bend, lean, turn], degrees=True).as_matrix()
    actual = posed(BODY, turns, directions)
    assert [actual[f"thorax.{name}"] for name in ("bend", "lean", "turn")] == pytest.approx([bend, lean, turn])
    assert [actual[f"head.{name}"] for name in ("bend", "lean", "turn")] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_pelvis_angles_in_the_world():
    turns, directions = standing(BODY)
    turns[0] = Rotation.from_euler("ZYX", [120.0, 15.0, -8.0], degrees=True).as_matrix()
    actual = posed(BODY, turns, directions)
    assert [actual[f"mid_hip.{name}"] for name in ("heading", "tilt", "list")] == pytest.approx([120.0, 15.0, -8.0])


def test_only_pelvis_angles_depend_on_the_world(rng):
    turns = Rotation.random(len(FEET.segments), rng=rng).as_matrix()
    directions = rng.normal(size=(len(FEET.bones), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    names, angles = joint_angles(FEET, turns, directions)
    world = Rotation.random(rng=rng).as_matrix()
    _, turned = joint_angles(FEET, world @ turns, directions @ world.T)
    inner = [not name.startswith("mid_hip.") for name in names]
    np.testing.assert_allclose(turned[inner], angles[inner], atol=1e-7)


def test_axial_rotations_are_about_the_bones(rng):
    turns = Rotation.random(50 * len(FEET.segments), rng=rng).as_matrix().reshape(50, -1, 3, 3)
    directions = rng.normal(size=(50, len(FEET.bones), 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    frames, _ = full_rotations(FEET, turns, directions)
    np.testing.assert_allclose(
        frames @ np.swapaxes(frames, -1, -2), np.broadcast_to(np.eye(3), frames.shape), atol=1e-9
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    np.testing.assert_allclose(frames[..., 2], directions, atol=1e-9)


def test_straight_limb_has_no_observed_twist_and_no_jump():
    turns, directions = standing(BODY)
    bends = np.linspace(0.0, 30.0, 301)
    wrist = BODY.bones.index("left_wrist")
    many = np.tile(directions, (len(bends), 1, 1))
    many[:, wrist] = np.array([down_and(b * 0.6, b * 0.8) for b in bends])
    frames, unseen = full_rotations(BODY, np.tile(turns, (len(bends), 1, 1, 1)), many)
    assert unseen[bends < 14.0, wrist].all()
    assert not unseen[bends > 16.0, wrist].any()
    steps = Rotation.from_matrix(np.swapaxes(frames[:-1, wrist], -1, -2) @ frames[1:, wrist]).magnitude()
    assert np.degrees(steps.max()) < 1.5


def test_missing_people_have_no_angles():
    turns, directions = standing(BODY)
    _, angles = joint_angles(BODY, np.full_like(turns, np.nan), np.full_like(directions, np.nan))
    assert np.isnan(angles).all()


def test_body_without_segments_has_angles_between_bones():
    tree = spanning_tree(
        ["tail", "back", "neck", "nose"], np.array([[0, 1], [1, 2], [2, 3]]), np.full(3, 0.1), 0.1, 0.3, np.arange(4)
    )
    assert tree.bones == ("tail", "neck", "nose")
    directions = np.array([[-1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [-0.8, 0.6, 0.0]])
    names, angles = joint_angles(tree, np.empty((0, 3, 3)), directions)
    assert dict(zip(names, angles, strict=True)) == pytest.approx({"back-neck.flexion": 53.1301, "neck.flexion": 90.0})


def test_knuckle_angle_is_continuous_for_a_finger_that_points_back():
    """The plane in which a finger bends defines its twist."""
    tree = shipped_skeleton("coco_wholebody_133").parts[0].tree
    turns, directions = standing(tree)
    second, third = (tree.bones.index(f"left_index_finger_{i}") for i in (2, 3))
    actual = []
    for twist in np.arange(-170.0, 171.0, 10.0):
        bent = Rotation.from_rotvec(np.radians(twist) * tree.rest[second]).as_matrix()
        curled = Rotation.from_euler("y", -60.0, degrees=True).as_matrix() @ tree.rest[second]
        directions[third] = bent @ curled
        angles = posed(tree, turns, directions)
        name = next(name for name in angles if name.startswith("left_index_finger_1") and name.endswith(".rotation"))
        actual.append(angles[name])
    steps = (np.diff(actual) + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(np.abs(steps), 10.0, atol=1e-6)
