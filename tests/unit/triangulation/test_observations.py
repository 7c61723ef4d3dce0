"""Points from subsets of the views: maximum likelihood, and linear with its covariance and status."""

import numpy as np
import pytest
from benchmarks.walking import walk

from posefuse.model.noise import NoiseModel
from posefuse.model.status import PointStatus
from posefuse.triangulation.observations import Observations


@pytest.fixture(scope="module")
def observations():
    data = walk(4, 4, outlier_share=0.3, outlier_px=(100.0, 900.0), seed=5)
    rows = np.arange(16).reshape(4, 4)
    noise = NoiseModel(np.full(4, 2.0), 0.0)
    return [
        Observations.gather(data.rig, data.detections, rows, noise, np.arange(4 * 26), linear=linear)
        for linear in (False, True)
    ]


def test_linear_points_have_the_covariance_and_status_of_the_views(observations):
    used = np.ones((104, 4), dtype=bool)
    likely, linear = (each.solve(used) for each in observations)
    both = (likely.status < PointStatus.NOT_SEEN) & (linear.status < PointStatus.NOT_SEEN)
    assert both.mean() > 0.9
    np.testing.assert_array_equal(linear.covariance_m2[both], likely.covariance_m2[both])
    assert np.abs(linear.points_m - likely.points_m)[both].max() > 0.01
    errors = observations[1].errors_px(linear.points_m)
    np.testing.assert_allclose(linear.view_error_px[both], errors[both], rtol=1e-5)
    np.testing.assert_allclose(linear.error_px[both], errors[both].mean(axis=-1), rtol=1e-9)


def test_linear_points_behind_a_used_camera_are_missing(observations):
    points, _ = observations[1].subset(np.ones((104, 4), dtype=bool))
    behind = np.isnan(observations[1].errors_px(points)).any(axis=-1)
    assert behind.any()
    solved = observations[1].solve(np.ones((104, 4), dtype=bool))
    assert not np.isfinite(solved.points_m[behind]).any()
    there = solved.status < PointStatus.NOT_SEEN
    for array in (solved.points_m, solved.covariance_m2, solved.view_error_px):
        np.testing.assert_array_equal(np.isfinite(array).all(axis=-1), there)


def test_subset_returns_the_points_of_the_solver(observations):
    used = np.ones((104, 4), dtype=bool)
    used[:, 1] = False
    for each in observations:
        solved, (points, _) = each.solve(used), each.subset(used)
        there = solved.status < PointStatus.NOT_SEEN
        np.testing.assert_array_equal(points[there], solved.points_m[there])
