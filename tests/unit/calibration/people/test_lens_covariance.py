"""Uncertain principal points: the stated covariance of the lenses is that of the joint estimate."""

import numpy as np
import pytest

from posefuse.calibration.people.lens_covariance import OtherLens, by_lens, principal_points
from tests.scenes import ring

N_VIEWS, SIZE = 3, 12
FOCAL_PX = np.array([800.0, 900.0, 1000.0])
UNKNOWN = np.array([True, False, True])


@pytest.fixture
def covariance(rng) -> np.ndarray:
    """Return a covariance in which only two principal points are uncertain."""
    root = 1e-2 * rng.standard_normal((N_VIEWS, SIZE, 60))
    root[1, 10:] = 0.0
    root = root.reshape(N_VIEWS * SIZE, -1)
    return root @ root.T


def test_covariance_of_principal_points_is_that_of_the_joint_estimate(covariance):
    other = principal_points(covariance, FOCAL_PX, UNKNOWN)
    assert other.parameters.tolist() == [[0, 8], [0, 9], [2, 8], [2, 9]]
    whole = covariance.reshape(N_VIEWS, SIZE, N_VIEWS, SIZE)
    stated = by_lens(ring(N_VIEWS), whole[:, :10, :, :10], other)
    views = np.array([0, 2])
    focal = FOCAL_PX[views]
    own = whole[views, 10:][:, :, views, 10:] * focal[:, None, None, None] * focal[:, None]
    assert stated[views, 8:10][:, :, views, 8:10] == pytest.approx(own)
    both = whole[:, :6, views, 10:] * focal[:, None]
    assert stated[:, :6, views, 8:10] == pytest.approx(both)
    assert stated[:, :6, :, :6] == pytest.approx(whole[:, :6, :, :6])
    assert not stated[1, 8:10].any()


def test_independent_parameters_of_lenses_add_up(covariance, rng):
    one = principal_points(covariance, FOCAL_PX, UNKNOWN)
    more = OtherLens(rng.standard_normal((N_VIEWS, 10, 1)), np.array([[0.25]]), np.array([[1, 10]]))
    assert (one + more).spread() == pytest.approx(one.spread() + more.spread())
    assert (one + more).parameters.tolist() == [*one.parameters.tolist(), [1, 10]]
