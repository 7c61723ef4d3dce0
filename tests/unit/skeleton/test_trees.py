"""Kinematic trees: valid tables, the resulting trees, and errors."""

import numpy as np
import pytest

from posefuse.kernels.tracking import body_kinematics
from posefuse.kernels.tracking.records import Pose
from posefuse.kinematics.initial_pose import node_offsets
from posefuse.skeleton.skeletons import shipped_skeleton, shipped_skeletons
from posefuse.skeleton.tree_tables import parse_tree
from posefuse.skeleton.trees import ADULT_M, CONE, HINGE, TWIST, Tree
from posefuse.tracking.body_states import body_of
from tests.kernels import from_python

locate = from_python(body_kinematics.locate_nodes)

KEYPOINTS = ["nose", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle"]
PARTNER = {"left_hip": "right_hip", "left_knee": "right_knee", "left_ankle": "right_ankle"}


def table(**changes: object) -> dict[str, object]:
    """Return the table of a pelvis with legs, and a head on a neck without a keypoint."""
    whole: dict[str, object] = {
        "segments": {"pelvis": {}, "head": {"at": "neck"}},
        "points": {
            "left_hip": ["pelvis", 0.0, 0.1, 0.02],
            "neck": ["pelvis", 0.0, 0.0, 0.5],
            "nose": ["head", 0.1, 0.0, 0.1],
        },
        "bones": {"left_knee": ["left_hip", 0.4], "left_ankle": ["left_knee", 0.38, [0.1, 0.2, -1.0]]},
        "hinges": {"left_ankle": ["pelvis", [0.0, 1.0, 0.0]]},
        "cones": {"left_knee": ["pelvis", [1.0, 0.5, 0.0], 60.0]},
        "twists": {"head": ["pelvis", [1.0, 0.0, 0.0], 80.0]},
    }
    return {**whole, **changes}


def tree_of(keypoints: list[str] = KEYPOINTS, **changes: object) -> Tree:
    return parse_tree(table(**changes), keypoints, PARTNER, "thing")


def at_rest(tree: Tree) -> dict[str, np.ndarray]:
    """Where the points of a standing body are."""
    bones = np.zeros((len(tree.bones), 3, 3))
    bones[:, :, 2] = tree.rest
    points = np.empty((len(tree.nodes), 3))
    turns = np.tile(np.eye(3), (len(tree.segments), 1, 1))
    locate(body_of(tree), Pose(np.zeros(3), turns, bones, np.asarray(tree.shape_m)), points)
    return {node.name: point for node, point in zip(tree.nodes, points, strict=True)}


def test_rest_pose_matches_the_table():
    points = at_rest(tree_of())
    shin = 0.38 * np.array([0.1, 0.2, -1.0]) / np.linalg.norm([0.1, 0.2, -1.0])
    np.testing.assert_allclose(points["left_hip"], [0.0, 0.1, 0.02], atol=1e-12)
    np.testing.assert_allclose(points["left_knee"], [0.0, 0.1, -0.38], atol=1e-12)
    np.testing.assert_allclose(points["left_ankle"], points["left_knee"] + shin, atol=1e-12)
    np.testing.assert_allclose(points["nose"], [0.1, 0.0, 0.6], atol=1e-12)


@pytest.mark.parametrize("name", [name for name in shipped_skeletons() if shipped_skeleton(name).tree is not None])
def test_rest_pose_is_symmetric(name):
    skeleton = shipped_skeleton(name)
    assert skeleton.tree is not None
    points = at_rest(skeleton.tree)
    for left, right in skeleton.pairs:
        assert (left in points) == (right in points)
        if left in points:
            np.testing.assert_allclose(points[right], points[left] * [1.0, -1.0, 1.0], atol=1e-12)


def test_sides_share_their_lengths():
    tree = tree_of()
    assert tree.shape_names == (
        "left_hip.left",
        "left_hip.up",
        "neck.up",
        "nose.forward",
        "nose.up",
        "left_knee",
        "left_ankle",
    )
    for left, right in PARTNER.items():
        assert tree.nodes[tree.node(left)].shape == tree.nodes[tree.node(right)].shape


def test_zero_coordinate_has_no_length_parameter():
    hip = tree_of().nodes[tree_of().node("left_hip")]
    assert hip.shape[0] == -1
    assert min(hip.shape[1:]) >= 0


def test_pose_parameters_are_counted():
    tree = tree_of()
    assert tree.n_pose == 3 + 3 * 2 + 2 * 4
    assert tree.n_shape == len(tree.shape_m) == 7


def test_points_without_keypoints_are_omitted_unless_they_have_children():
    assert {node.name for node in tree_of().nodes} >= {"pelvis", "neck", "nose"}
    legs = tree_of(KEYPOINTS[1:])
    assert {node.name for node in legs.nodes} == {"pelvis", *KEYPOINTS[1:]}
    assert legs.segments == ("pelvis",)
    assert [limit.kind for limit in legs.limits] == [HINGE, HINGE, CONE, CONE]
    hidden = parse_tree(table(), ["left_ankle", "right_ankle"], PARTNER, "thing")
    assert {node.name for node in hidden.nodes} == {"pelvis", *KEYPOINTS[1:]}
    np.testing.assert_array_equal(hidden.keypoint_nodes, [hidden.node("left_ankle"), hidden.node("right_ankle")])


def test_keypoints_missing_in_the_table_have_no_node():
    tree = tree_of([*KEYPOINTS, "tail"])
    assert tree.keypoint_nodes[-1] == -1
    assert (tree.keypoint_nodes[:-1] >= 0).all()


def test_parents_come_before_children():
    for name in shipped_skeletons():
        tree = shipped_skeleton(name).tree
        if tree is not None:
            assert all(node.parent < n for n, node in enumerate(tree.nodes))


def test_limits_hold_for_both_sides():
    tree = tree_of()
    hinges = [limit for limit in tree.limits if limit.kind == HINGE]
    cones = [limit for limit in tree.limits if limit.kind == CONE]
    (twist,) = [limit for limit in tree.limits if limit.kind == TWIST]
    assert [tree.bones[limit.bone] for limit in hinges] == ["left_ankle", "right_ankle"]
    assert [tree.bones[limit.before] for limit in hinges] == ["left_knee", "right_knee"]
    # A mirror turns cross products round but for their part across, which here is all of it.
    assert hinges[0].axis == hinges[1].axis == (0.0, 1.0, 0.0)
    np.testing.assert_allclose(cones[1].axis, np.array(cones[0].axis) * [1.0, -1.0, 1.0])
    assert cones[0].least == pytest.approx(0.5)
    assert (twist.bone, twist.segment) == (1, 0)
    assert twist.least == pytest.approx(np.cos(np.radians(80.0)))


def test_hinge_bends_the_same_way_on_both_sides():
    """Of a limb bent in any plane, and its mirror image, both overstep their hinge or neither does."""
    tree = tree_of(hinges={"left_ankle": ["pelvis", [0.3, 1.0, 0.2]]})
    left, right = (limit for limit in tree.limits if limit.kind == HINGE)
    rng = np.random.default_rng(3)
    for thigh, shin in rng.normal(size=(50, 2, 3)):
        here = np.cross(thigh, shin) @ left.axis
        mirror = np.array([1.0, -1.0, 1.0])
        assert np.cross(thigh * mirror, shin * mirror) @ right.axis == pytest.approx(here)


def test_shape_covariance_has_individual_and_common_parts():
    tree = tree_of(spread=0.1, size_spread=0.2)
    knee, ankle = tree.shape_names.index("left_knee"), tree.shape_names.index("left_ankle")
    assert tree.shape_covariance[knee, knee] == pytest.approx((0.1**2 + 0.2**2) * 0.4**2)
    assert tree.shape_covariance[knee, ankle] == pytest.approx(0.2**2 * 0.4 * 0.38)
    assert np.linalg.eigvalsh(tree.shape_covariance).min() > 0


def test_size_scales_lengths_of_options():
    assert tree_of().scale == 1.0
    assert tree_of(size_m=ADULT_M / 10).scale == pytest.approx(0.1)
    # How far a small body's points are off is small too.
    nose = tree_of().shape_names.index("nose.up")
    large, small = (t.shape_covariance[nose, nose] for t in (tree_of(spread=1e-6), tree_of(spread=1e-6, size_m=0.175)))
    assert large - small == pytest.approx(0.015**2 - 0.0015**2)


def test_several_twist_limits_of_a_segment():
    rows = [["pelvis", [1.0, 0.0, 0.0], 80.0], ["pelvis", [0.0, 2.0, 0.0], 60.0]]
    twists = [limit for limit in tree_of(twists={"head": rows}).limits if limit.kind == TWIST]
    assert [limit.axis for limit in twists] == [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    np.testing.assert_allclose([limit.least for limit in twists], np.cos(np.radians([80.0, 60.0])))


@pytest.mark.parametrize("name", ["mouse_22", "fly_38"])
def test_no_segment_of_an_animal_can_turn_over_unseen(name):
    # Views do not show how far a segment has turned about a line through all of its points.
    tree = shipped_skeleton(name).tree
    assert tree is not None
    offsets = node_offsets(tree, np.asarray(tree.shape_m))
    for s in range(len(tree.segments)):
        own = [n for n, node in enumerate(tree.nodes) if node.parent >= 0 and not node.is_bone and node.mover == s]
        _, sizes, axes = np.linalg.svd(np.vstack([offsets[own], np.zeros((2, 3))]))
        if sizes[1] > 0.01 * sizes[0]:
            continue
        limits = [limit for limit in tree.limits if limit.kind == TWIST and s in (limit.bone, limit.segment)]
        assert any(abs(axes[0] @ limit.axis) < 0.5 for limit in limits)
