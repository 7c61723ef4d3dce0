"""Keypoints of the model layer deviate from bodies as far as measured points show it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posefuse.model.reconstruction import pack_covariance, unpack_covariance
from posefuse.pipeline.people.keypoint_deviations import deviating_points
from tests.reference import keypoint_deviations as naive

INSIDE_68, INSIDE_95 = 3.506, 7.815


def points_of(rng, shape, sd_m):
    """Return points around 0 with covariances of about ``sd_m``."""
    factors = sd_m * (np.eye(3) + 0.3 * rng.standard_normal((*shape, 3, 3)))
    covariance = factors @ np.swapaxes(factors, -1, -2)
    return np.einsum("...ij,...j->...i", factors, rng.standard_normal((*shape, 3))), pack_covariance(covariance)


@pytest.mark.no_jit
@pytest.mark.parametrize(("own_m", "noise_m", "sd_m"), [(0.01, 0.02, 0.03), (0.01, 1.0, 0.001), (1e-6, 1e-6, 1e-5)])
def test_deviations_equal_the_naive_ones(own_m, noise_m, sd_m, rng):
    body, measured = points_of(rng, (6, 2, 4), own_m), points_of(rng, (6, 2, 4), noise_m)
    sds_m = sd_m * np.array([0.5, 1.0, 2.0, 4.0])
    for found, expected in zip(
        deviating_points(body, measured, sds_m), naive.deviating_points(body, measured, sds_m), strict=True
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_rigid_keypoints_do_not_change(rng):
    body, measured = points_of(rng, (5, 2, 3), 0.01), points_of(rng, (5, 2, 3), 0.02)
    points, covariance = deviating_points(body, measured, np.array([0.0, 0.05, 0.0]))
    for new, old in ((points, body[0]), (covariance, body[1])):
        assert np.array_equal(new[:, :, [0, 2]], old[:, :, [0, 2]])
        assert not np.isclose(new[:, :, 1], old[:, :, 1]).all(axis=-1).any()


def test_free_keypoints_are_the_measured_ones(rng):
    body, measured = points_of(rng, (5, 1, 3), 0.01), points_of(rng, (5, 1, 3), 0.02)
    points, covariance = deviating_points(body, measured, np.full(3, 1e4))
    assert np.allclose(points, measured[0], atol=1e-9)
    assert np.allclose(covariance, measured[1], atol=1e-9)


def test_deviations_of_keypoints_that_are_not_measured_are_unknown(rng):
    body, (measured, noise) = points_of(rng, (4, 1, 2), 0.01), points_of(rng, (4, 1, 2), 0.02)
    measured[1:3] = np.nan
    noise[2:] = np.nan
    points, covariance = deviating_points(body, (measured, noise), np.array([0.03, 0.03]))
    assert np.array_equal(points[1:], body[0][1:])
    assert np.allclose(covariance[1:] - body[1][1:], np.array([9e-4, 0, 0, 9e-4, 0, 9e-4]))
    assert np.isfinite(points).all()


def test_a_measured_point_of_the_other_side_hardly_moves_a_keypoint(rng):
    body, measured = points_of(rng, (50, 1, 1), 0.005), points_of(rng, (50, 1, 1), 0.01)
    measured[0][..., 0] += 0.4
    points, _ = deviating_points(body, measured, np.array([0.02]))
    assert np.linalg.norm(points - body[0], axis=-1).max() < 0.03


@pytest.mark.parametrize("sd_m", [0.005, 0.03])
def test_regions_of_deviating_keypoints_contain_the_truth_as_often_as_stated(sd_m, rng):
    # The body knows less about its point than the measurement, as with a lag, and their errors are independent.
    shape = (4000, 1, 1)
    body, (noise, covariance) = points_of(rng, shape, 0.004), points_of(rng, shape, 0.012)
    truth = sd_m * rng.standard_normal((*shape, 3))
    points, stated = deviating_points(body, (truth + noise, covariance), np.array([sd_m]))
    error = (points - truth)[:, 0, 0]
    squared = np.einsum(
        "ni,ni->n", error, np.linalg.solve(unpack_covariance(stated[:, 0, 0]), error[..., None])[..., 0]
    )
    assert 0.62 < (squared < INSIDE_68).mean() < 0.78
    assert 0.91 < (squared < INSIDE_95).mean() < 0.98


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(1e-5, 1.0), st.floats(1e-5, 1.0), st.floats(1e-5, 1.0), st.floats(0.0, 3.0))
def test_points_lie_between_body_and_measurement_and_covariances_are_valid(seed, own_m, noise_m, sd_m, apart_m):
    rng = np.random.default_rng(seed)
    body, measured = points_of(rng, (3, 1, 2), own_m), points_of(rng, (3, 1, 2), noise_m)
    measured[0][..., 1] += apart_m
    points, covariance = deviating_points(body, measured, np.full(2, sd_m))
    moved = np.linalg.norm(points - body[0], axis=-1)
    assert (moved <= np.linalg.norm(measured[0] - body[0], axis=-1) * (1.0 + 1e-9)).all()
    smallest = np.linalg.eigvalsh(unpack_covariance(covariance))
    assert (smallest[..., 0] >= -1e-9 * smallest[..., 2]).all()
