"""Samples of a known covariance, and motions of known acceleration."""

import numpy as np
import pytest

from posefuse.evaluation.consistency import consistency, nis, normalized_squares, region


def gaussian(rng, n: int, dof: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors, and the covariance of each: all different."""
    mixed = rng.normal(size=(n, dof, dof))
    covariances = 1e-4 * (mixed @ mixed.swapaxes(-1, -2) + 0.1 * np.eye(dof))
    return (np.linalg.cholesky(covariances) @ rng.normal(size=(n, dof, 1)))[..., 0], covariances


@pytest.mark.parametrize("dof", [2, 3])
def test_sample_of_the_covariance_is_consistent(dof, rng):
    actual = nis(*gaussian(rng, 40_000, dof))
    assert actual.n == 40_000
    assert actual.mean == pytest.approx(dof, rel=0.02)
    assert (actual.covered_68, actual.covered_95) == (pytest.approx(0.68, abs=0.01), pytest.approx(0.95, abs=0.005))


def test_overconfidence_is_detected(rng):
    errors, covariances = gaussian(rng, 20_000, 3)
    actual = nis(errors, covariances / 4)
    assert actual.mean == pytest.approx(12, rel=0.03)
    assert actual.covered_95 < 0.5


def test_coverage_of_known_regions():
    assert (region(0.68, 3), region(0.95, 3)) == (pytest.approx(3.5059, abs=1e-4), pytest.approx(7.8147, abs=1e-4))
    assert region(0.999, 2) == pytest.approx(13.816, abs=1e-3)


def test_points_without_covariance_are_ignored():
    errors = np.ones((4, 3))
    errors[0, 1] = np.nan
    covariances = np.stack([np.eye(3), np.full((3, 3), np.nan), np.zeros((3, 3)), 1e-8 * np.eye(3)])
    squares = normalized_squares(errors, covariances)
    assert np.isnan(squares[:3]).all()
    assert squares[3] == pytest.approx(3e8)
    assert consistency(squares[:3], 3).n == 0
    assert np.isnan(consistency(squares[:3], 3).covered_68)
    assert normalized_squares(np.empty((0, 3)), np.empty((0, 3, 3))).shape == (0,)


def test_consistency_does_not_depend_on_the_world_s_axes(rng):
    errors, covariances = gaussian(rng, 50, 3)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turned = normalized_squares(errors @ turn.T, turn @ covariances @ turn.T)
    np.testing.assert_allclose(turned, normalized_squares(errors, covariances))
