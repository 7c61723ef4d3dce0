"""Rotations of bones with a twist, compared with the naive ones."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.kinematics.twist import full_rotations
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.reference import twist as naive

pytestmark = pytest.mark.no_jit


@pytest.mark.parametrize("name", ["body_20", "mouse_22", "fly_38"])
def test_rotations_equal_the_naive_ones(name):
    rng = np.random.default_rng(0)
    tree = shipped_skeleton(name).tree
    assert tree is not None
    shape = (3, 4)
    turns = Rotation.random(12 * len(tree.segments) + 1, rng=rng).as_matrix()[:-1]
    turns = turns.reshape(*shape, len(tree.segments), 3, 3)
    directions = rng.normal(size=(*shape, len(tree.bones), 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    directions[0, 0, 0] = np.nan
    turns[1, :2] = np.eye(3)
    directions[1, 0], directions[1, 1] = np.asarray(tree.rest), -np.asarray(tree.rest)
    found, unseen = full_rotations(tree, turns, directions)
    expected, expected_unseen = naive.full_rotations(tree, turns, directions)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    np.testing.assert_array_equal(unseen, expected_unseen)
