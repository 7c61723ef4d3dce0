"""Rotations of vectors and quaternions, and rotations that fit matrices and points."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.model.rotations import (
    closest_rotation,
    rotations_from_quaternions,
    rotations_from_vectors,
    similarity_of_points,
)


def test_closest_rotation_agrees_with_an_independent_implementation():
    rng = np.random.default_rng(0)
    points, target = rng.standard_normal((2, 20, 40, 3))
    moments = np.einsum("kni,knj->kij", target, points)
    expected = [Rotation.align_vectors(b, a)[0].as_matrix() for a, b in zip(points, target, strict=True)]
    np.testing.assert_allclose(closest_rotation(moments), expected, atol=1e-9)


def test_closest_rotation_of_a_reflection_is_a_rotation():
    assert np.linalg.det(closest_rotation(np.diag([3.0, 2.0, -1.0]))) == pytest.approx(1.0)


def test_similarity_of_points_is_recovered():
    rng = np.random.default_rng(1)
    points, turn = rng.standard_normal((10, 3)), Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix()
    rotation, scale = similarity_of_points(points, 2.5 * points @ turn.T + [1.0, 2.0, 3.0])
    np.testing.assert_allclose(rotation, turn, atol=1e-12)
    assert scale == pytest.approx(2.5)
    assert similarity_of_points(np.ones((4, 3)), rng.standard_normal((4, 3)))[1] == 1.0


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-9, 1e-3, 0.5, 3.0, 50.0])
def test_rotations_of_vectors_agree_with_an_independent_implementation(angle):
    vectors = angle * np.random.default_rng(2).standard_normal((4, 5, 3))
    expected = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(4, 5, 3, 3)
    np.testing.assert_allclose(rotations_from_vectors(vectors), expected, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(rotations_from_vectors(vectors[0, 0]), expected[0, 0], rtol=0.0, atol=1e-15)


def test_rotations_of_no_vectors():
    assert rotations_from_vectors(np.empty((2, 0, 3))).shape == (2, 0, 3, 3)


def test_rotations_of_quaternions_agree_with_an_independent_implementation():
    quaternions = 3.0 * np.random.default_rng(3).standard_normal((40, 4))
    expected = Rotation.from_quat(quaternions).as_matrix()
    np.testing.assert_allclose(rotations_from_quaternions(quaternions), expected, rtol=0.0, atol=1e-15)
