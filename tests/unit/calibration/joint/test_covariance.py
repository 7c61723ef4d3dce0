"""The covariance of the score is the double sum over all pairs of times."""

import numpy as np
import pytest

from posefuse.calibration.joint.covariance import design_effect
from posefuse.kernels.calibration.joint import decaying_sums


@pytest.mark.no_jit
def test_decaying_sums_equal_the_double_sum(rng):
    time_s, reach_s = np.cumsum(rng.uniform(0.01, 0.2, 20)), 0.3
    rows = rng.standard_normal((20, 4, 3))
    summed = np.empty_like(rows)
    decaying_sums(rows, np.exp(-np.diff(time_s, prepend=time_s[0]) / reach_s), summed)
    for t in range(20):
        weights = np.exp(-(time_s[t] - time_s[: t + 1]) / reach_s)
        assert summed[t] == pytest.approx(np.einsum("t,tsp->sp", weights, rows[: t + 1]))


@pytest.mark.parametrize("alike", [1.0, 8.0])
def test_design_effect_counts_similar_observations(rng, alike):
    """Observations that come ``alike`` times each have ``alike`` times the spread that their curvature pretends."""
    rays = rng.standard_normal((200, 5))
    curvature = alike * rays.T @ rays
    assert design_effect(np.eye(5), curvature, alike * curvature) == pytest.approx(alike)
    assert design_effect(np.eye(5), curvature, 1e4 * curvature) == 50.0
