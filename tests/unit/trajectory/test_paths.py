"""Paths of some keypoints."""

import numpy as np

from posefuse.trajectory.paths import Paths


def _paths(value: float, keypoints: int) -> Paths:
    frames, views = 5, 2
    point = np.full((keypoints, frames, 3), value)
    matrix, row = np.full((keypoints, frames, 3, 3), value), np.full((keypoints, frames - 3), value)
    weights, alive = np.full((keypoints, frames, views), value), np.full((keypoints, frames), value > 1.0)
    return Paths(point, matrix, matrix, weights, alive, np.full(keypoints, value), row, row, row)


def test_joined_paths_have_each_keypoint_of_its_group():
    joined = Paths.joined([(np.array([0, 2]), _paths(1.0, 2)), (np.array([1]), _paths(2.0, 1))])
    np.testing.assert_array_equal(joined.paths_m[:, 0, 0], [1.0, 2.0, 1.0])
    np.testing.assert_array_equal(joined.alive[:, 0], [False, True, False])
    assert joined.alive.dtype == np.bool_


def test_some_keypoints_are_taken_and_replaced():
    replaced = _paths(1.0, 3).with_keypoints(np.array([2]), _paths(2.0, 1))
    np.testing.assert_array_equal(replaced.variance_m2, [1.0, 1.0, 2.0])
    np.testing.assert_array_equal(replaced.of_keypoints(np.array([1, 2])).variance_m2, [1.0, 2.0])
