"""Ratios of the cameras' errors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posefuse.noise.camera_factors import camera_factors
from posefuse.triangulation.linearized import LinearPoints


def _points(rng, scale_px, n=800):
    """Return points that cameras with these errors see from random directions."""
    jacobians = rng.standard_normal((n, len(scale_px), 2, 3)) * 100.0
    return LinearPoints(np.asarray(scale_px)[:, None] * rng.standard_normal((n, len(scale_px), 2)), jacobians)


@pytest.mark.parametrize("views", [3, 4, 8])
@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 1000), larger=st.floats(2.0, 4.0))
def test_camera_with_larger_errors_is_found(views, seed, larger):
    rng = np.random.default_rng(seed)
    scale = np.full(views, 2.0)
    scale[rng.integers(views)] *= larger
    factors = camera_factors(_points(rng, scale), np.full((800, views), 2.0))
    np.testing.assert_allclose(factors, scale / 2.0, rtol=0.3 if views == 3 else 0.25)


def test_cameras_that_are_alike_have_equal_factors(rng):
    assert (camera_factors(_points(rng, [2.0] * 5), np.full((800, 5), 1.0)) == 1.0).all()


def test_gross_outliers_of_one_camera_do_not_increase_its_factor(rng):
    points = _points(rng, [2.0] * 5)
    points.residuals_px[rng.random(800) < 0.2, 1] += 300.0
    np.testing.assert_allclose(camera_factors(points, np.full((800, 5), 2.0)), 1.0, atol=0.2)


def test_camera_that_shows_something_else_keeps_the_common_noise(rng):
    points = _points(rng, [2.0] * 5)
    points.residuals_px[rng.random(800) < 0.9, 1] += 3000.0
    np.testing.assert_allclose(camera_factors(points, np.full((800, 5), 2.0)), 1.0, atol=0.2)


def test_two_views_do_not_show_which_camera_is_wrong(rng):
    assert (camera_factors(_points(rng, [2.0, 9.0]), np.full((800, 2), 2.0)) == 1.0).all()
    sigma = np.full((800, 3), 2.0)
    sigma[20:, 2] = np.inf
    assert (camera_factors(_points(rng, [2.0, 9.0, 2.0]), sigma) == 1.0).all()


def test_errors_that_are_all_gross_show_no_factors(rng):
    points = _points(rng, [2e4] * 3)
    assert (camera_factors(points, np.full((800, 3), 2.0)) == 1.0).all()
