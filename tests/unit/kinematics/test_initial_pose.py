"""Initial poses from points."""

import numpy as np
from scipy.spatial.transform import Rotation

from posefuse.kinematics.initial_pose import bone_vectors, turn_bones
from tests.unit.tracking.test_track_initiation import SKELETON


def test_turned_bones_point_along_the_observed_vectors(rng):
    frames = Rotation.random(3, rng=rng).as_matrix()
    before = frames.copy()
    shown = np.array([-0.4 * frames[0][:, 2], [0.0, 0.3, 0.4], [np.nan, 0.0, 0.0]])
    turn_bones(frames, shown, range(3))
    np.testing.assert_allclose(frames[:2, :, 2], shown[:2] / np.linalg.norm(shown[:2], axis=1)[:, None], atol=1e-12)
    np.testing.assert_array_equal(frames[2], before[2])
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (3, 1, 1)), atol=1e-12)
    untouched = frames.copy()
    turn_bones(frames, -shown, [])
    np.testing.assert_array_equal(frames, untouched)


def test_bone_vectors_connect_joints(rng):
    tree = SKELETON.tree
    assert tree is not None
    points = rng.normal(size=(len(SKELETON), 3))
    points[SKELETON.index("left_wrist")] = np.nan
    shown = bone_vectors(tree, points)
    thigh = points[SKELETON.index("right_knee")] - points[SKELETON.index("right_hip")]
    np.testing.assert_allclose(shown[tree.bones.index("right_knee")], thigh)
    assert np.isnan(shown[tree.bones.index("left_wrist")]).all()
