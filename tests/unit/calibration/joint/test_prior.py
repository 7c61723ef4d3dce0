"""A prior keeps its meaning whatever its weight in the equations."""

import numpy as np

from posefuse.calibration.joint.prior import Prior


def test_standard_deviations_are_those_of_independent_changes():
    prior = Prior.of_sds(np.array([[0.5, 2.0]]))
    np.testing.assert_allclose(np.linalg.inv(prior.curvature), np.diag([0.25, 4.0]))
    np.testing.assert_array_equal(prior.curvature, prior.spread)
    np.testing.assert_allclose(prior.pull(np.array([0.5, 2.0])), [2.0, 0.5])


def test_coupled_parameters_have_the_given_covariance_and_mean():
    covariance = np.array([[1.0, 0.8], [0.8, 1.0]])
    prior = Prior.of_sds(np.ones((2, 2))).coupled(np.array([0, 2]), covariance, np.array([0.3, -0.3]))
    np.testing.assert_allclose(np.linalg.inv(prior.part(np.array([0, 2])).precision), covariance)
    np.testing.assert_allclose(prior.pull(np.array([0.3, 0.0, -0.3, 0.0])), 0.0, atol=1e-15)
    assert prior.part(np.array([1, 3])).precision.tolist() == np.eye(2).tolist()


def test_weighted_prior_is_right_for_observations_that_count_too_much():
    """Observations of information I that pretend w I: the sandwich with the weight w is the inverse of I + P."""
    information, weight = np.diag([3.0, 0.2]), 25.0
    prior = Prior.of_sds(np.array([[0.7, 1.5]])).weighted(np.full(2, weight))
    inverse = np.linalg.inv(weight * information + prior.curvature)
    sandwich = inverse @ (weight**2 * information + prior.spread) @ inverse
    np.testing.assert_allclose(sandwich, np.linalg.inv(information + prior.precision))
