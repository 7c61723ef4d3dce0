"""Skeletons: the shipped ones, their mappings, and TOML files."""

import numpy as np
import pytest

from posefuse.errors import SkeletonError
from posefuse.skeleton.skeletons import find_skeleton, parse_skeleton, shipped_skeleton, shipped_skeletons

SIZES = {
    "body_20": 20,
    "body_25": 25,
    "body_25b": 25,
    "coco_17": 17,
    "coco_wholebody_133": 133,
    "h36m_17": 17,
    "halpe_26": 26,
    "mediapipe_33": 33,
    "mediapipe_holistic_543": 543,
    "mediapipe_holistic_553": 553,
    "openpose_137": 137,
    "panoptic_19": 19,
    "mouse_22": 22,
    "fly_38": 38,
}
HUMANS = [name for name in SIZES if name not in ("mouse_22", "fly_38")]


def test_shipped_skeletons_are_listed():
    assert {name: len(shipped_skeleton(name)) for name in shipped_skeletons()} == SIZES


@pytest.mark.parametrize("name", SIZES)
def test_shipped_skeletons_are_consistent(name):
    skeleton = shipped_skeleton(name)
    assert skeleton.name == name
    assert skeleton.description
    np.testing.assert_array_equal(skeleton.mirror[skeleton.mirror], np.arange(len(skeleton)))
    for left, right in skeleton.pairs:
        assert left != right
        if left.startswith("left_"):
            assert right == f"right_{left[5:]}"
    for keypoint in skeleton.keypoints:
        if keypoint.startswith("left_"):
            assert skeleton.mirror[skeleton.index(keypoint)] != skeleton.index(keypoint)


@pytest.mark.parametrize("a", SIZES)
@pytest.mark.parametrize("b", SIZES)
def test_maps_keep_shared_names(a, b):
    one, other = shipped_skeleton(a), shipped_skeleton(b)
    sources = one.sources_of(other)
    for name, parts in sources.items():
        assert name in other.keypoints
        assert set(parts) <= set(one.keypoints)
        assert (name in one.keypoints) == (parts == (name,))
    assert {name for name in other.keypoints if name in one.keypoints} <= set(sources)


def test_every_body_maps_to_body_20_or_names_missing_keypoints():
    body = shipped_skeleton("body_20")
    assert set(shipped_skeleton("coco_17").sources_of(body)) == set(body.keypoints)
    assert set(shipped_skeleton("halpe_26").sources_of(body)) == set(body.keypoints)
    assert set(body.keypoints) - set(shipped_skeleton("h36m_17").sources_of(body)) == {
        "nose", "left_eye", "right_eye", "left_ear", "right_ear", "head",
    }  # fmt: skip


@pytest.mark.parametrize("name", HUMANS)
def test_core_of_a_body_consists_of_its_limb_joints(name):
    skeleton = shipped_skeleton(name)
    joints = {f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow", "wrist")}
    joints |= {f"{side}_{joint}" for side in ("left", "right") for joint in ("hip", "knee", "ankle")}
    assert {skeleton.keypoints[i] for i in skeleton.core_indices} == joints
    partners = skeleton.core_indices[skeleton.core_mirror]
    np.testing.assert_array_equal(partners, skeleton.mirror[skeleton.core_indices])
    assert len(skeleton.core_bones) == len(skeleton.plausible_m)
    for (a, b, low, high), (first, second, *range_m) in zip(skeleton.core_bones, skeleton.plausible_m, strict=True):
        places = skeleton.core_indices[[int(a), int(b)]]
        assert [skeleton.keypoints[i] for i in places] == [first, second]
        assert [low, high] == range_m


def test_all_keypoints_are_core_by_default():
    mouse = parse_skeleton('name = "mouse"\nkeypoints = ["nose", "left_ear", "right_ear"]', "mouse.toml")
    assert mouse.core_indices.tolist() == [0, 1, 2]
    assert mouse.core_mirror.tolist() == [0, 2, 1]
    half = parse_skeleton(
        'name = "mouse"\nkeypoints = ["nose", "left_ear", "right_ear"]\ncore = ["right_ear"]', "m.toml"
    )
    assert half.core_indices.tolist() == [2]
    assert half.core_mirror.tolist() == [0]


@pytest.mark.parametrize(
    ("core", "words"), [('["tail"]', "core names 'tail'"), ('["nose", "nose"]', "core repeats a key")]
)
def test_core_with_unknown_keypoints_is_refused(core, words):
    with pytest.raises(SkeletonError, match=words):
        parse_skeleton(f'name = "mouse"\nkeypoints = ["nose"]\ncore = {core}', "mouse.toml")


def test_rigid_edges_are_symmetric():
    arm = parse_skeleton(
        'name = "arm"\nkeypoints = ["neck", "left_elbow", "right_elbow"]\n'
        'edges = [["neck", "left_elbow"], ["neck", "right_elbow"]]\nrigid = [["neck", "left_elbow"]]',
        "arm.toml",
    )
    assert arm.rigid == (("neck", "left_elbow"), ("neck", "right_elbow"))
    with pytest.raises(SkeletonError, match="rigid contains 'left_elbow' and 'neck', which no edge connects"):
        parse_skeleton('name = "arm"\nkeypoints = ["neck", "left_elbow"]\nrigid = [["left_elbow", "neck"]]', "arm.toml")


def test_names_are_matched_in_any_spelling():
    assert find_skeleton("COCO-17") == find_skeleton("coco_17")
    assert find_skeleton("body20").name == "body_20"
    with pytest.raises(SkeletonError, match=r"Unknown skeleton 'coco_18'\. Did you mean 'coco_17'"):
        find_skeleton("coco_18")


def test_names_of_other_programs_are_recognized():
    skeleton = find_skeleton("body_25b")
    assert skeleton.canonical("RHip") == "right_hip"
    assert skeleton.canonical("Neck") == "upper_neck"
    assert skeleton.canonical("left_knee") == "left_knee"
    assert skeleton.canonical("Tail") is None


MOUSE = """
name = "mouse"
keypoints = ["snout", "earL", "earR", "tail_{0..2}"]
edges = [["snout", "earL"], ["snout", "earR"], ["tail_{0..1}", "tail_{1..2}"]]
pairs = [["earL", "earR"]]
[chains]
head = ["earL"]
"""


def test_animal_skeleton_is_read_from_a_file(tmp_path):
    path = tmp_path / "mouse.toml"
    path.write_text(MOUSE)
    mouse = find_skeleton(path)
    assert mouse.keypoints == ("snout", "earL", "earR", "tail_0", "tail_1", "tail_2")
    assert mouse.edges[2:] == (("tail_0", "tail_1"), ("tail_1", "tail_2"))
    assert mouse.chains == {"head": (("earL", "earR"),)}
    assert mouse.mirror.tolist() == [0, 2, 1, 3, 4, 5]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('"earR", "tail', '"earL", "tail'), "repeats keypoints: earL"),
        (('["snout", "earR"]', '["snout", "eraR"]'), "edges names 'eraR'.*Did you mean 'earR'"),
        (("edges", "egdes"), "unknown table 'egdes'. Did you mean 'edges'"),
        (('head = ["earL"]', 'head = ["snout"]'), "not the left name of a pair"),
        (('name = "mouse"', ""), "needs 'name'"),
        (('["snout", "earL"],', '["snout"],'), "two different names"),
        (('["snout", "earL"],', "[0, 1],"), "expected a list of names"),
        (('["snout", "earL"],', '["snout", "snout"],'), "two different names"),
        (("[chains]", "[chains"), "is not valid TOML"),
    ],
)
def test_invalid_skeleton_files_are_refused(change, words):
    with pytest.raises(SkeletonError, match=words):
        parse_skeleton(MOUSE.replace(*change), "mouse.toml")


def test_missing_file_is_an_error():
    with pytest.raises(SkeletonError, match="There is no skeleton file rat.toml"):
        find_skeleton("rat.toml")
