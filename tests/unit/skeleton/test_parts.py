"""Parts of bodies: which skeletons have them, and that a right one is the mirror image of the left."""

import numpy as np
import pytest

from posefuse.errors import SkeletonError
from posefuse.io.netcdf import skeleton_from_text, skeleton_text
from posefuse.kernels.tracking import body_kinematics
from posefuse.kernels.tracking.records import Pose
from posefuse.kinematics.initial_pose import pose_from_points
from posefuse.skeleton.parts import Part, parse_parts
from posefuse.skeleton.skeletons import parse_skeleton, shipped_skeleton, shipped_skeletons
from posefuse.skeleton.tree_tables import parse_tree
from posefuse.skeleton.trees import HINGE, Tree
from posefuse.tracking.body_states import body_of
from tests.kernels import from_python

locate = from_python(body_kinematics.locate_nodes)
WHOLE = shipped_skeleton("coco_wholebody_133")
assert WHOLE.tree is not None
BODY: Tree = WHOLE.tree
MIRROR = np.array([1.0, -1.0, 1.0])


def standing(tree: Tree, tips: np.ndarray | None = None) -> np.ndarray:
    """Shape (node, 3): where nodes are with turns of nothing and bones along ``tips``, by default at rest."""
    bones = np.zeros((len(tree.bones), 3, 3))
    bones[:, :, 2] = tree.rest if tips is None else tips
    points = np.empty((len(tree.nodes), 3))
    turns = np.tile(np.eye(3), (len(tree.segments), 1, 1))
    locate(body_of(tree), Pose(np.zeros(3), turns, bones, np.array(tree.shape_m)), points)
    return points


def part(name: str) -> Part:
    return next(each for each in WHOLE.parts if each.name == name)


def test_only_whole_body_skeletons_have_parts():
    names = {name: [each.name for each in shipped_skeleton(name).parts] for name in shipped_skeletons()}
    assert names["coco_wholebody_133"] == names["openpose_137"] == ["left_hand", "right_hand", "face"]
    assert names["mediapipe_holistic_543"] == ["left_hand", "right_hand"]
    for name in ("body_20", "coco_17", "halpe_26", "body_25", "mouse_22", "fly_38", "mediapipe_33"):
        assert names[name] == []


@pytest.mark.parametrize("skeleton", ["coco_wholebody_133", "openpose_137", "mediapipe_holistic_553"])
def test_every_keypoint_is_in_one_tree_and_every_part_keypoint_has_a_node(skeleton):
    whole = shipped_skeleton(skeleton)
    assert whole.tree is not None
    first = np.concatenate([each.keypoints for each in whole.parts])
    assert len(set(first.tolist())) == len(first)
    assert (whole.tree.keypoint_nodes[first] < 0).all()
    for each in whole.parts:
        assert (each.tree.keypoint_nodes >= 0).all()
        names = [each.tree.nodes[n].name for n in each.tree.keypoint_nodes]
        assert names == [whole.keypoints[k] for k in each.keypoints]


def test_all_133_keypoints_of_a_whole_body_are_modeled():
    modeled = (BODY.keypoint_nodes >= 0).sum() + sum(len(each.keypoints) for each in WHOLE.parts)
    assert modeled == len(WHOLE) == 133


def test_right_hand_mirrors_the_left_hand():
    left, right = part("left_hand"), part("right_hand")
    np.testing.assert_array_equal(WHOLE.mirror[left.keypoints], right.keypoints)
    np.testing.assert_allclose(standing(right.tree), standing(left.tree) * MIRROR, atol=1e-12)
    np.testing.assert_array_equal(left.tree.shape_m, right.tree.shape_m)
    assert WHOLE.keypoints[left.at] == "left_wrist"
    assert WHOLE.keypoints[right.at] == "right_wrist"


def test_face_is_symmetric():
    face = part("face")
    points = standing(face.tree)[face.tree.keypoint_nodes]
    places = {k: i for i, k in enumerate(face.keypoints.tolist())}
    partner = [places[int(WHOLE.mirror[k])] for k in face.keypoints]
    np.testing.assert_allclose(points[partner], points * MIRROR, atol=1e-12)
    assert BODY.segments[face.like] == "head"


@pytest.mark.parametrize("side", ["left", "right"])
def test_fingers_bend_towards_the_palm_only(side):
    tree = part(f"{side}_hand").tree
    far, near = np.array([0.5, 0.0, -0.8]), np.array([0.0, 0.0, -1.0])
    hinges = [limit for limit in tree.limits if limit.kind == HINGE]
    assert len(hinges) == 8
    for limit in hinges:
        inwards = np.cross(near, far) @ limit.axis
        assert inwards > limit.least
        assert -inwards < limit.least


def test_initial_pose_of_a_face_recovers_its_rotation(rng):
    tree = part("face").tree
    truth = standing(tree)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = truth[tree.keypoint_nodes] @ turn.T + [1.0, 2.0, 1.5]
    root, turns, _ = pose_from_points(tree, moved, np.array(tree.shape_m))
    # A first pose leans a little toward no turn at all.
    np.testing.assert_allclose(root, [1.0, 2.0, 1.5], atol=5e-3)
    np.testing.assert_allclose(turns, np.stack([turn, turn]), atol=0.05)


def test_offset_points_add_no_lengths():
    table = {
        "segments": {"trunk": {}},
        "points": {
            "eye": ["trunk", 0.1, 0.02, 0.3],
            "lid": ["eye", 0.0, 0.01, 0.02],
            "tail": ["trunk", -0.3, 0.0, 0.0],
        },
    }
    tree = parse_tree(table, ["lid", "tail"], {}, "thing")
    assert tree.shape_names == ("eye.forward", "eye.left", "eye.up", "tail.forward")
    np.testing.assert_allclose(standing(tree)[tree.node("lid")], [0.1, 0.03, 0.32])
    with pytest.raises(SkeletonError, match="unknown segment 'ear'"):
        parse_tree({**table, "points": {"lid": ["ear", 0.0, 0.0, 0.1]}}, ["lid"], {}, "thing")


def test_parts_round_trip():
    back = skeleton_from_text(skeleton_text(WHOLE))
    for first, second in zip(WHOLE.parts, back.parts, strict=True):
        assert (first.name, first.at, first.like) == (second.name, second.at, second.like)
        np.testing.assert_array_equal(first.keypoints, second.keypoints)
        assert first.tree.nodes == second.tree.nodes
        assert first.tree.limits == second.tree.limits
    mouse = shipped_skeleton("mouse_22")
    read = skeleton_from_text(skeleton_text(mouse)).tree
    assert mouse.tree is not None
    assert read is not None
    assert read.size_m == mouse.tree.size_m


def test_missing_part_is_named():
    with pytest.raises(SkeletonError, match=r"Unknown shared body 'wing'.*hand"):
        parse_parts({"parts": ["wing"]}, WHOLE.tree, WHOLE.keypoints, {}, "thing")
    with pytest.raises(SkeletonError, match="tree.parts must be a list of part names"):
        parse_parts({"parts": "hand"}, WHOLE.tree, WHOLE.keypoints, {}, "thing")
    beside = 'name = "a"\nkeypoints = ["b", "c"]\n[tree]\nparts = ["hand"]\n[tree.segments]\nt = {}\n'
    assert parse_skeleton(beside + '[tree.points]\nb = ["t", 0.1, 0.0, 0.0]\n', "a.toml").parts == ()
