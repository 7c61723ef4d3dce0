"""Samples of a known covariance, and motions of known acceleration."""

import numpy as np
import pytest

from posefuse.evaluation.consistency import consistency, nis, normalized_squares, region
from posefuse.evaluation.motion import accelerations_m_s2, bone_spreads, jitter


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


TIME_S = np.arange(40) / 25.0


def falling() -> np.ndarray:
    points = np.zeros((40, 1, 2, 3))
    points[..., 2] = (-0.5 * 9.81 * TIME_S**2)[:, None, None]
    points[:, :, 1, 0] = 1.0
    return points


def test_acceleration_of_free_fall_and_double_gravity():
    truth = falling()
    np.testing.assert_allclose(accelerations_m_s2(truth, TIME_S), 9.81)
    actual = jitter(2.0 * truth, truth, np.zeros((40, 1), dtype=int), TIME_S)
    assert (actual.result_m_s2, actual.ratio, actual.n) == (pytest.approx(19.62), pytest.approx(2), 76)


def test_identity_changes_and_gaps_are_not_motion():
    truth = falling()
    ours = truth.copy()
    ours[20:] += 5.0
    person = np.zeros((40, 1), dtype=int)
    assert jitter(ours, truth, person, TIME_S).n == 76
    person[20:] = 1
    actual = jitter(ours, truth, person, TIME_S)
    assert (actual.n, actual.ratio) == (72, pytest.approx(1))
    late = TIME_S + np.where(np.arange(40) >= 20, 3.0, 0.0)
    assert np.isnan(accelerations_m_s2(truth, late)[:, 0, 0]).sum() == 2
    assert jitter(ours[:2], truth[:2], person[:2], TIME_S[:2]).n == 0


def test_motionless_points_have_no_ratio():
    still = np.zeros((10, 1, 1, 3))
    actual = jitter(still, still, np.zeros((10, 1), dtype=int), TIME_S[:10])
    assert actual.result_m_s2 == 0
    assert np.isnan(actual.ratio)


def test_bone_lengths(rng):
    points = np.zeros((4000, 2, 3, 3))
    points[:, :, 1, 0] = 0.4 * (1 + np.array([0.02, 0.04]) * rng.standard_normal((4000, 2)))
    points[:, :, 2] = np.nan
    spreads = bone_spreads(points, np.array([[0, 1], [0, 2]]))
    assert spreads[0] == pytest.approx(0.03, rel=0.05)
    assert np.isnan(spreads[1])
