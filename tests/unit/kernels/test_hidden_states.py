"""Posterior probabilities of hidden states, against all paths of states."""

import numpy as np
import pytest

from posefuse.kernels.biomechanics.hidden_states import forward_backward
from tests.reference.hidden_states import enumerate_paths


@pytest.mark.no_jit
@pytest.mark.parametrize("seed", range(4))
def test_probabilities_are_sums_over_all_paths(seed):
    rng = np.random.default_rng(seed)
    likelihoods = np.exp(rng.normal(0.0, 3.0, (5, 3)))
    transitions = rng.dirichlet(np.ones(3), (2, 3))
    which, prior = rng.integers(0, 2, 5), rng.dirichlet(np.ones(3))
    posterior = np.empty((5, 3))
    forward_backward(likelihoods, transitions, which, prior, posterior, np.empty((2, 3)))
    np.testing.assert_allclose(posterior, enumerate_paths(likelihoods, transitions, which, prior), atol=1e-12)


def test_impossible_observations_stay_finite():
    likelihoods = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
    posterior = np.empty((3, 2))
    which = np.zeros(3, dtype=np.int64)
    forward_backward(likelihoods, np.eye(2)[None], which, np.array([1.0, 0.0]), posterior, np.empty((2, 2)))
    assert np.isfinite(posterior).all()
