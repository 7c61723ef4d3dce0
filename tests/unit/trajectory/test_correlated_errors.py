"""Correlation of detection errors."""

import numpy as np
import pytest

from posefuse.trajectory.correlated_errors import mean_cosine


@pytest.mark.parametrize("freedom", [1, 2, 7])
@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_mean_cosine_matches_sampled_vectors(freedom, correlation):
    one, other = np.random.default_rng(freedom).standard_normal((2, 40_000, freedom))
    other = correlation * one + np.sqrt(1.0 - correlation**2) * other
    cosine = (one * other).sum(axis=1) / np.linalg.norm(one, axis=1) / np.linalg.norm(other, axis=1)
    assert cosine.mean() == pytest.approx(float(mean_cosine(np.array(correlation), freedom)), abs=0.015)
