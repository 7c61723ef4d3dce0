"""Bones of the trajectory solve: groups of keypoints that they connect."""

import numpy as np

from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.trajectory.bones import Bones


def groups_of(bones: Bones) -> list[tuple[set[int], set[int]]]:
    """Return the keypoints and the bones of each group."""
    tiles, own_bones, ends = bones.groups
    starts = np.vstack([np.zeros((1, 2), dtype=np.int64), ends])[:-1]
    return [
        (set(tiles[first:end].ravel().tolist()) - {-1}, set(own_bones[first_bone:end_bone].tolist()))
        for (first, first_bone), (end, end_bone) in zip(starts, ends, strict=True)
    ]


def test_groups_hold_every_keypoint_and_bone_once_and_no_bone_leaves_its_group():
    skeleton = shipped_skeleton("coco_wholebody_133")
    bones = Bones.of(skeleton)
    groups = groups_of(bones)
    assert sorted(k for keypoints, _ in groups for k in keypoints) == list(range(len(skeleton)))
    assert sorted(b for _, own in groups for b in own) == list(range(len(bones.ends)))
    for keypoints, own in groups:
        assert all(set(bones.ends[b].tolist()) <= keypoints for b in own)
        # A connected group of n keypoints has n - 1 bones or more.
        assert len(own) >= len(keypoints) - 1
    assert len(groups) == 11


def test_keypoints_without_bones_are_one_group():
    assert groups_of(Bones.none(3)) == [({0, 1, 2}, set())]
    assert groups_of(Bones.none(0)) == []


def test_batches_hold_whole_groups_and_every_keypoint_once():
    skeleton = shipped_skeleton("coco_wholebody_133")
    bones = Bones.of(skeleton)
    batches = bones.batches
    np.testing.assert_array_equal(np.sort(np.concatenate(batches)), np.arange(len(skeleton)))
    for keypoints in batches:
        own, kept = bones.of_keypoints(keypoints)
        np.testing.assert_array_equal(keypoints[own.ends], bones.ends[kept])
        groups = groups_of(own)
        assert sorted(k for of_group, _ in groups for k in of_group) == list(range(len(keypoints)))
        assert sorted(b for _, of_group in groups for b in of_group) == list(range(len(own.ends)))
        assert len(own.order) == np.isin(bones.order[:, 0], kept).sum()
