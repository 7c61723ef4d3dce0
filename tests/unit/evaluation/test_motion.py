"""Accelerations, jitter and bone lengths of results."""

import numpy as np
import pytest

from posefuse.evaluation.motion import accelerations_m_s2, bone_spreads, jitter

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
