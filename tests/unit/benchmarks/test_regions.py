"""Groups of keypoints of the benchmark of regions."""

import pytest
from benchmarks.regions import groups

from posefuse.skeleton.skeletons import find_skeleton


@pytest.mark.parametrize("skeleton", ["halpe_26", "coco_wholebody_133"])
def test_no_group_is_empty(skeleton):
    assert all(members.any() for members in groups(find_skeleton(skeleton)).values())


def test_hands_have_ten_fingertips():
    assert groups(find_skeleton("coco_wholebody_133"))["fingertips"].sum() == 10
