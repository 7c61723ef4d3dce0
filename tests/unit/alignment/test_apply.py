"""Applying an alignment to a result."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.alignment.apply import align, in_calibration_world
from posefuse.errors import ResultError
from posefuse.model.alignment import Alignment
from tests.people import simulate_walkers, track_perfectly

MOVED = Alignment(Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([1.0, -2.0, 3.0]), 2.5, "y", "z")


def test_alignment_can_be_undone(walker):
    result = track_perfectly(simulate_walkers())
    other = align(result, MOVED)
    assert other.alignment == MOVED
    assert other.rig.up_axis == "y"
    for name, layer in result.layers.items():
        points = np.asarray(layer.points_m)
        np.testing.assert_allclose(
            other.rig.project(np.asarray(other.layers[name].points_m)), result.rig.project(points), atol=1e-6
        )
    turns, before = np.asarray(other.poses.turns), np.asarray(result.poses.turns)
    np.testing.assert_allclose(turns, MOVED.rotation @ before, atol=1e-12)
    np.testing.assert_allclose(np.asarray(other.poses.shape_m), 2.5 * np.asarray(result.poses.shape_m))
    back = in_calibration_world(other)
    assert back.alignment is None
    assert back.rig.up_axis == "z"
    for name, layer in result.layers.items():
        np.testing.assert_allclose(np.asarray(back.layers[name].points_m), np.asarray(layer.points_m), atol=1e-12)
        np.testing.assert_allclose(
            np.asarray(back.layers[name].covariance_m2), np.asarray(layer.covariance_m2), rtol=1e-9, atol=1e-15
        )
    np.testing.assert_allclose(
        back.rig.cameras[1].camera_from_world, result.rig.cameras[1].camera_from_world, atol=1e-12
    )


def test_covariances_rotate_with_their_points():
    rng = np.random.default_rng(0)
    result = track_perfectly(simulate_walkers())
    layer = result.layers["model"]
    root = rng.normal(size=(3, 3)) * 0.01
    full = root @ root.T
    entries = np.broadcast_to(full[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]], layer.covariance_m2.shape).copy()
    results = replace(result, layers={"model": replace(layer, covariance_m2=entries)})
    actual = np.asarray(align(results, MOVED).layers["model"].covariance_m2)[0, 0, 0]
    by_hand = 2.5**2 * MOVED.rotation @ full @ MOVED.rotation.T
    np.testing.assert_allclose(actual, by_hand[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]])


def test_mirroring_alignment_is_an_error():
    with pytest.raises(ResultError, match="rotation"):
        Alignment(np.diag([1.0, 1.0, -1.0]), np.zeros(3))
