"""Posterior probabilities of the states of a hidden Markov model."""

from posefuse.kernels.jit import kernel


@kernel
def forward_backward(likelihoods, transitions, which, prior, posterior, scratch):
    """Compute the probability of every state at every time from all observations.

    The scaled forward and backward recursions of Rabiner (1989), A tutorial on hidden Markov models, section V.

    Args:
        likelihoods: shape (time, state): likelihoods of the observations, in any unit per time; equal where there are
            none.
        transitions: shape (matrix, state, state): probabilities from the row's state to the column's state.
        which: shape (time,), int64: transition matrix from the previous time to this one; the first is not used.
        prior: shape (state,): probabilities at the first time.
        posterior: shape (time, state): output.
        scratch: shape (2, state): work space.
    """
    n_times, n_states = likelihoods.shape
    for t in range(n_times):
        norm = 1e-300
        for j in range(n_states):
            value = prior[j]
            if t > 0:
                value = 0.0
                for i in range(n_states):
                    value += posterior[t - 1, i] * transitions[which[t], i, j]
            posterior[t, j] = value * likelihoods[t, j]
            norm += posterior[t, j]
        for j in range(n_states):
            posterior[t, j] /= norm
    for j in range(n_states):
        scratch[0, j] = 1.0
    for back in range(1, n_times):
        t = n_times - 1 - back
        norm = 1e-300
        for i in range(n_states):
            value = 0.0
            for j in range(n_states):
                value += transitions[which[t + 1], i, j] * likelihoods[t + 1, j] * scratch[0, j]
            scratch[1, i] = value
            norm += value
        whole = 1e-300
        for i in range(n_states):
            scratch[0, i] = scratch[1, i] / norm
            posterior[t, i] *= scratch[0, i]
            whole += posterior[t, i]
        for i in range(n_states):
            posterior[t, i] /= whole
