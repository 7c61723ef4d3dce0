"""Mixture of inliers and outliers."""

import numpy as np
import pytest

from posefuse.noise.mixture import fit_mixture
from posefuse.triangulation.linearized import LinearPoints
from tests.unit.triangulation.test_linearized import observed

SIGMA_PX = 2.0


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
