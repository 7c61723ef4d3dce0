"""Axes of files."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.io.results.axes import minimal_y_up_from_world, y_up_from_world
from posefuse.model.cameras import UP_AXES, up_vector


@pytest.mark.parametrize("up", UP_AXES)
def test_rotation_maps_up_to_y(up):
    turn = y_up_from_world(up)
    axis = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}[up[-1]]
    np.testing.assert_allclose(turn @ (np.array(axis) * (-1 if up[0] == "-" else 1)), [0, 1, 0])
    np.testing.assert_allclose(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)


@pytest.mark.parametrize("up", UP_AXES)
def test_rotation_to_y_up_is_minimal(up):
    turn = minimal_y_up_from_world(up)
    np.testing.assert_allclose(turn @ up_vector(up), [0, 1, 0])
    np.testing.assert_allclose(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)
    between = np.arccos(up_vector(up)[1])
    assert Rotation.from_matrix(turn).magnitude() == pytest.approx(between)
