"""Bones of constant length."""

import numpy as np

from posefuse.postprocess.bones import Bones, hierarchy, make_rigid, median_bones
from posefuse.skeleton.skeletons import find_skeleton, shipped_skeletons


def breathing(rng, frames=30, people=2):
    skeleton = find_skeleton("halpe_26")
    links = hierarchy(skeleton)
    points = np.zeros((frames, people, len(skeleton), 3))
    points[:, :, links[0, 0]] = rng.normal(size=(frames, people, 3))
    directions = rng.normal(size=(frames, people, len(links), 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    for b, (near, far) in enumerate(links):
        points[:, :, far] = points[:, :, near] + 0.3 * rng.uniform(0.9, 1.1, (frames, people, 1)) * directions[:, :, b]
    return skeleton, links, points, directions


def test_hierarchy_is_a_forest():
    for name in shipped_skeletons():
        skeleton = find_skeleton(name)
        links = hierarchy(skeleton)
        assert len(set(links[:, 1].tolist())) == len(links)
        reached = set()
        for near, far in links.tolist():
            reached.add(near)
            assert far not in reached
            reached.add(far)


def test_bones_get_their_median_length_and_keep_their_direction():
    skeleton, links, points, directions = breathing(np.random.default_rng(0))
    bones = median_bones([points[:10], points[10:]], skeleton)
    by_hand = np.median(np.linalg.norm(points[:, 0, links[3, 0]] - points[:, 0, links[3, 1]], axis=-1))
    assert bones.length_m[0, 3] == by_hand
    out = make_rigid(points, bones)
    along = out[:, :, links[:, 1]] - out[:, :, links[:, 0]]
    np.testing.assert_allclose(np.linalg.norm(along, axis=-1), np.broadcast_to(bones.length_m, along.shape[:-1]))
    np.testing.assert_allclose(along / np.linalg.norm(along, axis=-1, keepdims=True), directions, atol=1e-9)
    root = links[0, 0]
    np.testing.assert_array_equal(out[:, :, root], points[:, :, root])
    np.testing.assert_allclose(make_rigid(out, bones), out, atol=1e-12)


def test_missing_points_stay_missing_and_descendants_stay():
    skeleton, _, points, _ = breathing(np.random.default_rng(1))
    knee, ankle = skeleton.index("left_knee"), skeleton.index("left_ankle")
    points[5, 0, knee] = np.nan
    out = make_rigid(points, median_bones([points], skeleton))
    assert np.isnan(out[5, 0, knee]).all()
    np.testing.assert_array_equal(out[5, 0, ankle], points[5, 0, ankle])
    assert np.array_equal(np.isnan(out), np.isnan(points))


def test_person_without_observations_stays_unchanged():
    links = np.array([[0, 1]])
    points = np.random.default_rng(2).normal(size=(4, 1, 2, 3))
    np.testing.assert_array_equal(make_rigid(points, Bones(links, np.array([[np.nan]]))), points)
