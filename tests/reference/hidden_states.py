"""Naive twin of the forward-backward algorithm."""

from itertools import product

import numpy as np


def enumerate_paths(
    likelihoods: np.ndarray, transitions: np.ndarray, which: np.ndarray, prior: np.ndarray
) -> np.ndarray:
    """Return the posterior probabilities by the sum over all paths of states."""
    n_times, n_states = likelihoods.shape
    posterior = np.zeros((n_times, n_states))
    for path in product(range(n_states), repeat=n_times):
        weight = prior[path[0]]
        for t in range(1, n_times):
            weight *= transitions[which[t], path[t - 1], path[t]]
        weight *= np.prod([likelihoods[t, state] for t, state in enumerate(path)])
        for t, state in enumerate(path):
            posterior[t, state] += weight
    return posterior / posterior[0].sum()
