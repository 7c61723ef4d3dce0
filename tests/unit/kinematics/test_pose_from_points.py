"""Poses of bodies from points alone."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.kinematics.joint_angles import joint_angles
from posefuse.kinematics.pose_from_points import pose_of_points
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate


@pytest.fixture(scope="module")
def points():
    scene = simulate(SceneOptions(duration_s=0.4, cameras=2, detector=CLEAN))
    assert scene.truth.skeleton.name == "halpe_26"
    return np.asarray(scene.truth.best_layer()[1].points_m)


def angles(points):
    tree = find_skeleton("halpe_26").tree
    names, degrees = joint_angles(tree, *pose_of_points(tree, points))
    return dict(zip(names, np.moveaxis(degrees, -1, 0), strict=True))


def test_knee_angle_matches_hand_computed_value(points):
    skeleton = find_skeleton("halpe_26")
    hip, knee, ankle = (points[:, 0, skeleton.index(f"left_{name}")] for name in ("hip", "knee", "ankle"))
    thigh, shank = knee - hip, ankle - knee
    cosine = np.einsum("fi,fi->f", thigh, shank) / np.linalg.norm(thigh, axis=1) / np.linalg.norm(shank, axis=1)
    np.testing.assert_allclose(angles(points)["left_knee.flexion"][:, 0], np.degrees(np.arccos(cosine)), atol=1e-6)


def test_rotation_about_the_up_axis_changes_only_the_heading(points):
    turn = Rotation.from_euler("z", 40, degrees=True).as_matrix()
    before, after = angles(points), angles(points @ turn.T)
    for name, values in before.items():
        change = (after[name] - values + 180) % 360 - 180
        expected = 40.0 if name == "mid_hip.heading" else 0.0
        np.testing.assert_allclose(change[np.isfinite(change)], expected, atol=0.5, err_msg=name)


def test_unseen_points_give_no_pose(points):
    skeleton = find_skeleton("halpe_26")
    holed = points.copy()
    holed[:, :, skeleton.index("left_knee")] = np.nan
    actual = angles(holed)
    assert np.isnan(actual["left_knee.flexion"]).all()
    assert np.isnan(actual["left_hip.flexion"]).all()
    assert np.isfinite(actual["right_knee.flexion"]).all()


def test_pose_of_points_recovers_a_known_pose(points):
    """Points of a body with average lengths recover the pose."""
    tree = find_skeleton("halpe_26").tree
    turns, directions = pose_of_points(tree, points)
    again = np.full_like(points, np.nan)
    places = np.zeros((len(tree.nodes), 3))
    _, _, _, fixed, shape_of, signs, _, _ = tree.packed
    places = np.where(shape_of >= 0, signs * np.append(tree.shape_m, 0.0)[shape_of], fixed)
    at = np.zeros((*points.shape[:2], len(tree.nodes), 3))
    for n, node in enumerate(tree.nodes[1:], 1):
        if node.is_bone:
            step = places[n, 2] * directions[..., node.mover, :]
        else:
            step = np.einsum("fpij,j->fpi", turns[..., node.mover, :, :], places[n])
        at[..., n, :] = at[..., node.parent, :] + step
    for k, n in enumerate(tree.keypoint_nodes):
        if n >= 0:
            again[..., k, :] = at[..., n, :]
    found_turns, found_directions = pose_of_points(tree, again)
    # The pelvis is shown by hips and, a little, by the thorax, which bends against it.
    np.testing.assert_allclose(found_turns[..., 1:, :, :], turns[..., 1:, :, :], atol=2e-3)
    np.testing.assert_allclose(found_directions, directions, atol=1e-9)
