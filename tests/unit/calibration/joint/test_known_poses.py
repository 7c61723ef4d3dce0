"""The prior of known poses: invariant to the world, and with the information of the stated covariance."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.joint.known_poses import KnownPoses, rigid_changes
from posefuse.model.camera_covariance import CENTER, MATRIX, ROTATION, separated
from tests.scenes import ring

LEAST = 1e-6, 1e-6


def known_rig(n=3, lens=False, seed=0):
    rng = np.random.default_rng(seed)
    rig = ring(n)
    names = (*ROTATION, *CENTER, *(MATRIX if lens else ()))
    parameters = [(camera, name) for camera in rig.names for name in names]
    units = np.tile([1e-3] * 3 + [2e-3] * 3 + [2.0] * 4 * lens, n)
    root = rng.normal(size=(len(parameters), 2 * len(parameters))) * units[:, None] / np.sqrt(len(parameters))
    covariances, correlation = separated(parameters, root @ root.T, "origin")
    return replace(rig, covariances=covariances, correlation=correlation)


def stated(rig):
    joint = rig.covariance()
    assert joint is not None
    return joint.matrix


def changes_of_the_world(rig):
    out = np.zeros((len(rig), 10, 6))
    for v, camera in enumerate(rig.cameras):
        out[v, :6] = rigid_changes(camera)
    return out.reshape(-1, 6)


def test_a_common_motion_is_free_and_the_scale_is_not():
    rig = known_rig()
    precision = KnownPoses.of(rig, np.arange(3), 3, LEAST).matrix(10)
    world = changes_of_the_world(rig)
    typical = np.linalg.norm(precision)
    assert np.abs(precision @ world).max() < 1e-6 * typical
    scale = np.zeros((3, 10))
    scale[:, 3:6] = [camera.center_m for camera in rig.cameras]
    assert scale.ravel() @ precision @ scale.ravel() > 1.0


def test_relative_poses_have_the_stated_covariance():
    """The prior of two cameras, given the pose of the first, is that of their difference."""
    rig = known_rig(2)
    precision = KnownPoses.of(rig, np.arange(2), 2, LEAST).matrix(6)
    given_first = np.linalg.inv(precision[6:, 6:])
    turn = np.kron(np.eye(4), np.eye(3))
    for v, camera in enumerate(rig.cameras):
        turn[6 * v + 3 : 6 * v + 6, 6 * v + 3 : 6 * v + 6] = camera.rotation.T
    both = turn @ stated(rig) @ turn.T
    follow = -rigid_changes(rig.cameras[1]) @ np.linalg.inv(rigid_changes(rig.cameras[0]))
    relative = np.concatenate([follow, np.eye(6)], axis=1)
    assert given_first == pytest.approx(relative @ both @ relative.T, rel=1e-3, abs=1e-10)


def test_the_order_of_the_views_does_not_matter():
    rig = known_rig()
    one = KnownPoses.of(rig, np.array([0, 1, 2]), 4, LEAST).precision
    other = KnownPoses.of(rig, np.array([3, 0, 1]), 4, LEAST).precision
    at = [3, 0, 1]
    assert np.allclose(other[at][:, :, at], one[:3, :, :3])
    assert not one[3].any()


def test_other_parameters_of_lenses_are_fixed_and_followed():
    rig = known_rig(2, lens=True)
    known = KnownPoses.of(rig, np.arange(2), 2, LEAST)
    assert known.other_parameters.tolist() == [[0, 7], [0, 8], [0, 9], [1, 7], [1, 8], [1, 9]]
    covariance, k = stated(rig), [7, 8, 9, 17, 18, 19]
    assert known.other_covariance[1:3, 1:3] == pytest.approx(covariance[np.ix_(k, k)][1:3, 1:3])
    # The marginal variance is the one given the others, plus what follows from theirs.
    spread = known.other[0, 8] @ known.other_covariance @ known.other[0, 8]
    assert 0.0 < spread < 1.0
    both = KnownPoses.of(rig, np.arange(2), 4, LEAST) + KnownPoses.of(rig, np.array([2, 3]), 4, LEAST)
    assert both.other.shape == (4, 10, 12)
    assert both.other_parameters[6:].tolist() == [[2, 7], [2, 8], [2, 9], [3, 7], [3, 8], [3, 9]]


def test_principal_points_are_not_known():
    precision = KnownPoses.of(known_rig(), np.arange(3), 3, LEAST)
    whole = precision.matrix(12).reshape(3, 12, 3, 12)
    np.testing.assert_array_equal(whole[:, :10, :, :10].reshape(30, 30), precision.matrix(10))
    assert not whole[:, 10:].any()
    assert not whole[..., 10:].any()


def test_the_pose_of_a_single_camera_is_unknown_to_rounding():
    """Its lens alone is known. A weak prior stays positive definite with it, also if the known lens counts often."""
    rig = ring(3).select(ring(3).names[1:2])
    names = (*ROTATION, *CENTER, *MATRIX)
    parameters = [(rig.names[0], name) for name in names]
    root = np.zeros((len(names), 20))
    root[6:] = np.random.default_rng(1).normal(size=(4, 20))
    covariances, correlation = separated(parameters, root @ root.T, "origin")
    alone = replace(rig, covariances=covariances, correlation=correlation)
    precision = KnownPoses.of(alone, np.array([1]), 3, (1e-5, 1e-5)).matrix(10)
    assert precision[18, 18] > 1.0
    assert np.linalg.eigvalsh(precision)[0] > -1e-6
    np.linalg.cholesky(100.0 * precision + 20.0**-2 * np.eye(30))
