"""Limbs far from their predicted pose are fitted."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.kernels.tracking.projection import project_people
from posefuse.kernels.tracking.records import State
from posefuse.kinematics.initial_pose import bone_vectors, turn_bones
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.track_initiation import fit_body
from tests.unit.tracking.test_track_initiation import SKELETON, settings_with, standing


def test_bones_are_turned_to_where_they_are_shown(rng):
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


def test_bones_go_from_joint_to_joint(rng):
    tree = SKELETON.tree
    assert tree is not None
    points = rng.normal(size=(len(SKELETON), 3))
    points[SKELETON.index("left_wrist")] = np.nan
    shown = bone_vectors(tree, points)
    thigh = points[SKELETON.index("right_knee")] - points[SKELETON.index("right_hip")]
    np.testing.assert_allclose(shown[tree.bones.index("right_knee")], thigh)
    assert np.isnan(shown[tree.bones.index("left_wrist")]).all()


@pytest.mark.parametrize("thigh", [[0.6, 0.0, 0.8], [0.4, -0.3, 0.9]])
def test_leg_seen_late_is_fitted(thigh):
    """Gauss-Newton steps from the rest pose fail, because robust weights of distant keypoints vanish."""
    settings = settings_with()
    tree, leg = settings.tree, [SKELETON.index(name) for name in ("right_knee", "right_ankle")]
    shown = np.full((len(tree.bones), 3), np.nan)
    shown[tree.bones.index("right_knee")] = thigh

    def lift_leg(body: State) -> None:
        turn_bones(body.bones[0], shown, range(len(tree.bones)))

    seen = standing(settings, np.arange(5) / 25.0, lift_leg)
    for each in seen[:3]:
        each.keypoints_px[:, leg], each.points_m[leg] = np.nan, np.nan
    state = fit_body(seen, settings)[0]
    projected = ProjectedBodies.allocate(1, 0, len(SKELETON))
    project_people(settings.cameras[:0], settings.body, state, projected.arrays)
    np.testing.assert_allclose(projected.points_m[0, leg], seen[-1].points_m[leg], atol=0.05)
