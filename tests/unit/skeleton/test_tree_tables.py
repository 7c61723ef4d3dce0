"""Tables of kinematic trees."""

import re

import pytest

from posefuse.errors import SkeletonError
from posefuse.skeleton.skeletons import parse_skeleton
from posefuse.skeleton.tree_tables import shared_body
from tests.unit.skeleton.test_trees import tree_of

KEYPOINTS = ["nose", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle"]
PARTNER = {"left_hip": "right_hip", "left_knee": "right_knee", "left_ankle": "right_ankle"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"segmants": {}}, "tree: unknown table 'segmants'. Did you mean 'segments'?"),
        ({"spread": -0.1}, "tree.spread must be a positive number, got -0.1"),
        ({"size_m": "large"}, "tree.size_m must be a positive number, got 'large'"),
        ({"segments": {}}, "tree has no segments; at least one is needed, and the first is the root"),
        ({"segments": {"pelvis": {"at": "neck"}}}, "tree.segments.pelvis must be {}, because it is the root"),
        (
            {"segments": {"pelvis": {}, "head": {}}},
            'tree.segments.head must be { at = "the point about which it rotates" }',
        ),
        ({"segments": {"pelvis": {}, "left_foot": {"at": "left_ankle"}}}, "but no 'right_foot'; define both"),
        ({"points": {"nose": ["head", 0.1, 0.0]}}, "tree.points.nose must be [segment or point, forward, left, up]"),
        ({"points": {"nose": ["haed", 0.1, 0.0, 0.1]}}, "unknown segment 'haed'. Did you mean 'head'?"),
        ({"bones": {"left_knee": ["left_hip", -0.4]}}, "tree.bones.left_knee must be [point, length] or"),
        ({"bones": {"left_knee": ["left_hip", 0.4, [0, 0, 0]]}}, "tree.bones.left_knee must be"),
        ({"hinges": {"left_ankle": ["pelvis", [0, 1]]}}, "left_ankle must be [segment, [forward, left, up]]"),
        ({"hinges": {"left_ankel": ["pelvis", [0, 1, 0]]}}, "not the end of a bone. Did you mean 'left_ankle'?"),
        ({"hinges": {"left_knee": ["pelvis", [0, 1, 0]]}}, "no bone that ends at 'left_hip'"),
        ({"cones": {"left_knee": ["pelvis", [0, 1, 0]]}}, "left_knee must be [segment, [forward, left, up], degrees]"),
        ({"twists": {"hat": ["pelvis", [0, 1, 0], 9]}}, "tree.twists contains 'hat', which is not a segment"),
        ({"twists": {"head": ["palvis", [0, 1, 0], 9]}}, "unknown segment 'palvis'. Did you mean 'pelvis'?"),
        (
            {"twists": {"head": [["pelvis", [1, 0, 0], 9], ["pelvis", [0, 1, 0]]]}},
            "tree.twists.head must be [segment, [forward, left, up], degrees] or a list of such rows",
        ),
        ({"bones": {"nose": ["neck", 0.1]}}, "'nose' is defined twice"),
        ({"bones": {"left_knee": ["left_hop", 0.4]}}, "points left_knee of the tree have unknown parents"),
    ],
)  # fmt: skip
def test_errors_name_the_fault_and_valid_names(changes, message):
    if "hinges" not in changes:
        changes = {"hinges": {}, **changes}
    if "bones" in changes:
        changes = {"cones": {}, **changes}
    if "segments" in changes:
        changes = {"points": {}, "bones": {}, "cones": {}, "twists": {}, **changes}
    with pytest.raises(SkeletonError, match=re.escape(message)) as caught:
        tree_of(**changes)
    assert "'thing'" in str(caught.value)


def test_referenced_body_must_exist():
    with pytest.raises(SkeletonError, match=r"Unknown shared body 'humna'. Did you mean 'human'"):
        shared_body("humna")
    with pytest.raises(SkeletonError, match="tree must be a table or the name of a shared body, got 3"):
        parse_skeleton('name = "thing"\nkeypoints = ["a"]\ntree = 3', "thing.toml")
