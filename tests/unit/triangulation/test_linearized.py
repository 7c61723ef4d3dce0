"""Linearized points, and the mixture of inliers and outliers estimated from them."""

import numpy as np
import pytest

from posefuse.model.noise import NoiseModel
from posefuse.noise.leave_one_out import choose_pairs
from posefuse.noise.mixture import fit_mixture
from posefuse.triangulation.linearized import LinearPoints
from posefuse.triangulation.observations import Observations
from tests.scenes import LENSES, body_points, ring

SIGMA_PX = 2.0


def observed(rng, lens="pinhole", views=5, n=300):
    """Return noisy observations and the true points."""
    rig = ring(views, lens)
    truth = body_points(rng, n, 1)[:, 0]
    pixels = np.moveaxis(rig.project(truth), 0, 1)
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


@pytest.mark.parametrize("size_px", [0.0, 8.0, 10.0, 20.0, 100.0])
def test_noise_of_inliers_is_estimated_despite_outliers(size_px, rng):
    """One observation of five is off by ``size_px`` at every point."""
    observations, truth = observed(rng, n=1500)
    view, angle = rng.integers(0, 5, 1500), rng.uniform(0, 2 * np.pi, 1500)
    observations.pixels[np.arange(1500), view] += size_px * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    actual = fit_mixture(LinearPoints.at(observations, truth).fit(np.full((1500, 5), SIGMA_PX)))
    assert actual.scale == pytest.approx(1.0, rel=0.05)
    if size_px >= 20.0:
        assert (actual.outlier.argmax(axis=1) == view).mean() > 0.97
        assert actual.all_inliers.mean() < 0.05
    if size_px == 0.0:
        assert actual.all_inliers.mean() > 0.95


def test_scale_is_relative_to_sigma(rng):
    observations, truth = observed(rng)
    linear = LinearPoints.at(observations, truth)
    one, other = (fit_mixture(linear.fit(np.full((300, 5), sigma))).scale for sigma in (1.0, 4.0))
    assert one == pytest.approx(4.0 * other, rel=0.01)


def test_pairs_stay_within_their_piece():
    """A pair joins a point with the next frame if that is informative and in the same piece."""
    telling = np.ones((6, 1, 2), dtype=bool)
    telling[1, 0, 0] = False
    pairs = choose_pairs(telling, (0, 4), 100).reshape(-1, 2).tolist()
    assert pairs == [[0, 0], [1, 3], [3, 5], [4, 6], [5, 7], [6, 6], [7, 7], [8, 10], [9, 11], [10, 10], [11, 11]]
    few = choose_pairs(telling, (0, 4), 2).reshape(-1, 2)[:, 0].tolist()
    assert few == [0, 7, 8, 11]
    assert choose_pairs(np.zeros((3, 1, 2), dtype=bool), (0, 1), 5).tolist() == []


def test_points_without_views_have_zero_residuals(rng):
    observations, truth = observed(rng, n=4)
    sigma = np.full((4, 5), SIGMA_PX)
    sigma[1] = np.inf
    fit = LinearPoints.at(observations, truth).fit(sigma)
    assert not fit.used[1].any()
    assert (fit.residuals[1] == 0.0).all()
    assert np.isfinite(fit.residuals).all()
