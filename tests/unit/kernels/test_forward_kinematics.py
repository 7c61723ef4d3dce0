"""Forward kinematics against recursion."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.kernels.synthetic.forward_kinematics import forward_kinematics
from tests.reference import chains as naive

pytestmark = pytest.mark.no_jit


def test_agrees_with_the_reference(rng):
    parents = np.array([-1, 0, 1, 1, 0, 4, 5])
    offsets = rng.normal(size=(7, 3))
    turning = np.array([0, 1, -1, 2, -1, 3, -1])
    rotations = Rotation.random(5 * 4, random_state=1).as_matrix().reshape(5, 4, 3, 3)
    root = rng.normal(size=(5, 3))
    found = np.empty((5, 7, 3))
    forward_kinematics(parents, offsets, turning, rotations, root, found, np.empty((7, 3, 3)))
    np.testing.assert_allclose(found, naive.positions(parents, offsets, turning, rotations, root), atol=1e-12)


def test_root_without_rotation(rng):
    parents, turning = np.array([-1, 0]), np.array([-1, -1])
    offsets, root = rng.normal(size=(2, 3)), rng.normal(size=(3, 3))
    found = np.empty((3, 2, 3))
    forward_kinematics(parents, offsets, turning, np.empty((3, 0, 3, 3)), root, found, np.empty((2, 3, 3)))
    np.testing.assert_allclose(found[:, 1] - found[:, 0], np.tile(offsets[1], (3, 1)))
