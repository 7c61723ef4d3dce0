"""Matching detections to people."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from posefuse.kernels.tracking.matching import keypoint_log_odds, match_views
from tests.kernels import from_python
from tests.properties import examples


def best_gain(scores: np.ndarray, least: float) -> float:
    """Match with SciPy, with one additional column per row."""
    own = np.full((len(scores), len(scores)), -1e9)
    np.fill_diagonal(own, least)
    gain = np.hstack([np.where(scores > least, scores, -1e9), own])
    return float(gain[linear_sum_assignment(gain, maximize=True)].sum())


@examples(60)
@given(st.integers(1, 6), st.integers(0, 7), st.integers(0, 5), st.integers(0, 10**6))
def test_matching_has_the_maximum_gain(people, first, second, seed):
    rng = np.random.default_rng(seed)
    scores = rng.normal(size=(people, first + second))
    scores[rng.random(scores.shape) < 0.2] = -np.inf
    views = np.repeat([0, 1], [first, second])
    rows = np.empty((people, 2), dtype=np.int64)
    match_views(scores, views, 2, 0.1, rows)
    for v in range(2):
        mine = np.flatnonzero(views == v)
        taken = rows[rows[:, v] >= 0, v]
        assert len(set(taken)) == len(taken)
        assert set(taken) <= set(mine)
        gained = sum(scores[p, rows[p, v]] if rows[p, v] >= 0 else 0.1 for p in range(people))
        np.testing.assert_allclose(gained, best_gain(scores[:, mine], 0.1))


@pytest.mark.parametrize("nu", [0.5, 2.5, 1e6])
def test_log_odds_are_bounded_below_and_exact_otherwise(nu):
    of_residual = from_python(keypoint_log_odds)
    uu, uv, vv, area, least = 9.0, 2.0, 16.0, 4e4, -3.0
    determinant = uu * vv - uv * uv
    found, told = [], []
    for du in np.geomspace(0.1, 1e5, 2000):
        squared = (vv * du * du - 2.0 * uv * du * 2.0 * du + uu * 4.0 * du * du) / determinant
        ratio = math.log(area / (2.0 * math.pi * math.sqrt(determinant))) - (nu / 2 + 1) * math.log1p(squared / nu)
        told.append(max(ratio, least))
        found.append(of_residual(du, 2.0 * du, uu, uv, vv, nu, area, least, math.exp(-least)))
    np.testing.assert_allclose(found, told, rtol=1e-9, atol=1e-9)
    assert found[0] > 0.0
    assert found[-1] == least
