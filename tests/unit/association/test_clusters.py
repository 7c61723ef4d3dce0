"""Covariance-normalized distances between people, and centers of trunks."""

import numpy as np
import pytest

from posefuse.association.clusters import cluster, distance_squared
from posefuse.association.trunk import six


def spread_of(sigma_m: float, *shape: int) -> np.ndarray:
    return np.broadcast_to(six(np.eye(3) * sigma_m**2), (*shape, 6)).copy()


class TestDistance:
    def test_by_hand(self):
        a, b = np.zeros((1, 2, 3)), np.array([[[0.3, 0.0, 0.0], [0.0, 0.4, 0.0]]])
        # Variances add: 0.01 + 0.01; 0.09 / 0.02 and 0.16 / 0.02, and the mean of the two.
        actual = distance_squared(a, spread_of(0.1, 1, 2), b, spread_of(0.1, 1, 2))
        assert actual == pytest.approx(np.array([[6.25]]))

    def test_expected_distance_does_not_depend_on_the_number_of_keypoints(self):
        rng = np.random.default_rng(0)
        factor = rng.normal(0.0, 0.05, (300, 17, 3, 3))
        spread = factor @ np.swapaxes(factor, -1, -2) + 0.01**2 * np.eye(3)
        draws = np.einsum("nkij,tnkj->tnki", np.linalg.cholesky(spread), rng.standard_normal((2, 300, 17, 3)))
        for common in (1, 5, 17):
            a, b = draws.copy()
            a[:, common:] = np.nan
            actual = np.diagonal(distance_squared(a, six(spread), b, six(spread)))
            assert actual.mean() == pytest.approx(3.0, abs=0.5)

    def test_distance_is_invariant_to_rotations(self):
        rng = np.random.default_rng(1)
        a, b = rng.normal(size=(3, 5, 3)), rng.normal(size=(2, 5, 3))
        factor = rng.normal(size=(3, 5, 3, 3))
        spread = factor @ np.swapaxes(factor, -1, -2) + np.eye(3)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        before = distance_squared(a, six(spread), b, spread_of(0.2, 2, 5))
        after = distance_squared(a @ turn.T, six(turn @ spread @ turn.T), b @ turn.T, spread_of(0.2, 2, 5))
        np.testing.assert_allclose(before, after)

    def test_people_with_too_few_common_keypoints_have_no_distance(self):
        a, b = np.zeros((1, 3, 3)), np.zeros((1, 3, 3))
        a[0, 0], b[0, 2] = np.nan, np.nan
        own = spread_of(0.1, 1, 3)
        assert distance_squared(a, own, b, own)[0, 0] == 0.0
        assert np.isnan(distance_squared(a, own, b, own, min_common=2)[0, 0])
        b[0, 1] = np.nan
        assert np.isnan(distance_squared(a, own, b, own)[0, 0])

    def test_noise_floor_reduces_distances(self):
        a, b = np.zeros((1, 2, 3)), np.full((1, 2, 3), 0.03)
        own = spread_of(0.0, 1, 2)
        assert distance_squared(a, own, b, own, floor_m=0.03)[0, 0] == pytest.approx(3.0)

    def test_clusters_are_chained_and_numbered_in_order(self):
        x = np.array([5.0, 0.0, 0.25, 5.1, 0.5])
        points = np.zeros((5, 2, 3))
        points[..., 0] = x[:, None]
        assert cluster(points, spread_of(0.1, 5, 2), 4.0).tolist() == [0, 1, 1, 0, 1]
        assert cluster(points, spread_of(0.1, 5, 2), 1.0).tolist() == [0, 1, 2, 0, 3]
        assert cluster(np.empty((0, 2, 3)), np.empty((0, 2, 6)), 1.0).shape == (0,)
