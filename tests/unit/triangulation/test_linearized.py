"""Linearized points, and the mixture of inliers and outliers estimated from them."""

import numpy as np
import pytest

from posefuse.model.noise import NoiseModel
from posefuse.triangulation.linearized import LinearPoints
from posefuse.triangulation.observations import Observations
from tests.scenes import LENSES, body_points, ring

SIGMA_PX = 2.0


def observed(rng, lens="pinhole", views=5, n=300):
    """Return noisy observations and the true points."""
    rig = ring(views, lens)
    truth = body_points(rng, n, 1)[:, 0]
    pixels = rig.project(truth)
    pixels = pixels + SIGMA_PX * rng.standard_normal(pixels.shape)
    return Observations(rig, NoiseModel(np.full(views, SIGMA_PX)), pixels, np.full(pixels.shape[:2], np.nan)), truth


@pytest.mark.parametrize("lens", LENSES)
def test_jacobians_match_finite_differences(lens, rng):
    observations, truth = observed(rng, lens, n=20)
    linear = LinearPoints.at(observations, truth)
    step = 1e-5
    for i in range(3):
        ahead, behind = (truth + sign * step * np.eye(3)[i] for sign in (1, -1))
        change = LinearPoints.at(observations, ahead).residuals_px - LinearPoints.at(observations, behind).residuals_px
        np.testing.assert_allclose(linear.jacobians[..., i], change / (2 * step), rtol=1e-5, atol=1e-3)


def test_missing_observations_are_ignored(rng):
    observations, truth = observed(rng, n=5)
    observations.pixels[2, 1] = np.nan
    fit = LinearPoints.at(observations, truth).fit(np.full((5, 5), SIGMA_PX))
    assert not fit.used[2, 1]
    assert fit.degrees_of_freedom[2] == 5.0
    assert fit.degrees_of_freedom[0] == 7.0


def test_fits_match_the_solver(rng):
    """Linearized about the truth or about the solution, residuals are those of the solver."""
    observations, truth = observed(rng)
    used = rng.random((300, 5)) < 0.8
    used[:, :2] = True
    solved = observations.solve(used)
    fit = LinearPoints.at(observations, truth).fit(np.where(used, SIGMA_PX, np.inf))
    expected = LinearPoints.at(observations, solved.points_m).residuals_px / SIGMA_PX
    np.testing.assert_allclose(fit.residuals[used], expected[used], atol=0.02)
    np.testing.assert_allclose(np.trace(fit.shares, axis1=-2, axis2=-1).sum(axis=1), 3.0, rtol=1e-6)


def test_leave_one_out_equals_a_fit_without_the_view(rng):
    observations, truth = observed(rng, n=50)
    linear = LinearPoints.at(observations, truth)
    sigma = np.full((50, 5), SIGMA_PX)
    fit = linear.fit(sigma)
    left_out, inverse = fit.leave_one_out()
    gain = np.einsum("nva,nvab,nvb->nv", left_out, inverse, left_out)
    sigma[:, 3] = np.inf
    without = linear.fit(sigma)
    np.testing.assert_allclose(fit.squared - gain[:, 3], without.squared, rtol=1e-6)


def test_points_without_views_have_zero_residuals(rng):
    observations, truth = observed(rng, n=4)
    sigma = np.full((4, 5), SIGMA_PX)
    sigma[1] = np.inf
    fit = LinearPoints.at(observations, truth).fit(sigma)
    assert not fit.used[1].any()
    assert (fit.residuals[1] == 0.0).all()
    assert np.isfinite(fit.residuals).all()
