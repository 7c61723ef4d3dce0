"""Stated covariances of calibrations by a board agree with the errors."""

import numpy as np
import pytest
from benchmarks.board_coverage import BoardOptions, run

from posefuse.calibration.boards.covariance import _inflation, _persistence, _score_covariance

N_PERIODS, N_PARAMETERS = 12, 9


def periods(rng, correlation=0.0, poses=6):
    """Scores of periods whose poses have equal curvature, in which fitted parameters leave no gradient."""
    share = np.eye(N_PARAMETERS) / N_PERIODS
    state, scores = rng.normal(size=N_PARAMETERS), []
    for _ in range(N_PERIODS * poses):
        scores.append(state)
        state = correlation * state + np.sqrt(1.0 - correlation**2) * rng.normal(size=N_PARAMETERS)
    sums = np.array(scores).reshape(N_PERIODS, poses, -1).sum(axis=1) / np.sqrt(N_PERIODS * poses)
    return [(share, own - sums.mean(axis=0)) for own in sums]


@pytest.mark.parametrize("degrees", [8, 20])
def test_inflated_covariances_have_the_expected_squared_errors(degrees):
    rng = np.random.default_rng(5)
    draws = rng.standard_normal((20_000, degrees + 1, 3))
    covariance = _inflation(degrees) * np.einsum("kni,knj->kij", draws[:, 1:], draws[:, 1:]) / degrees
    errors = draws[:, 0]
    squared = (errors * np.linalg.solve(covariance, errors[..., None])[..., 0]).sum(axis=1)
    assert squared.mean() == pytest.approx(3.0, rel=0.05)


@pytest.mark.parametrize(("correlation", "least", "most"), [(0.0, 0.95, 1.25), (0.8, 6.0, 14.0)])
def test_errors_that_outlast_a_period_are_part_of_the_variance(correlation, least, most):
    """At correlation r, the variance of the sum is (1 + r) / (1 - r) times that of independent errors."""
    rng = np.random.default_rng(3)
    found = [_score_covariance(periods(rng, correlation), 6 * N_PERIODS) for _ in range(100)]
    assert least < np.mean([np.trace(each) for each in found]) / N_PARAMETERS < most


def test_independent_periods_have_no_persistence():
    rng = np.random.default_rng(4)
    factors = []
    for _ in range(50):
        own = periods(rng)
        factors.append(_persistence(own, np.array([score for _, score in own]), 6.0))
    # Correlations below 0, which occur by chance, do not decrease the variance.
    assert np.mean(factors) < 1.15


def test_stated_variances_of_blurred_images_of_a_bent_board_are_those_of_the_errors():
    """Squared errors in units of the variance are about 1; before, those of centers and offsets were about 3."""
    nees = []
    for seed in range(4):
        options = BoardOptions("corner", 4, "checkerboard", 60, True, 0.0, 0.2, "all", seed)
        found = run(options)["nees"]
        nees += [found[name] for name in ("rotation", "center", "offset")]
    assert 0.4 < np.mean(nees) < 1.6
