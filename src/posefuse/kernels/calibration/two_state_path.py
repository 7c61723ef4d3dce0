"""The most probable path of two states over time."""

import numpy as np

from posefuse.kernels.jit import kernel


@kernel
def two_state_path(gain, switch_cost, path):
    """Write the path that maximizes the gain of the second state minus the cost of switches (Viterbi).

    Args:
        gain: shape (frame,): gain of the second state over the first.
        switch_cost: shape (frame,): cost of a change of the state before each frame; the first is not used.
        path: shape (frame,), bool, written: whether the second state holds.
    """
    n = gain.shape[0]
    came_from = np.zeros((n, 2), dtype=np.bool_)
    first, second = 0.0, 0.0
    for i in range(n):
        if i > 0:
            cost = switch_cost[i]
            came_from[i, 0] = second - cost > first
            came_from[i, 1] = second >= first - cost
            first, second = max(first, second - cost), max(second, first - cost)
        second += gain[i]
    state = second > first
    for i in range(n - 1, -1, -1):
        path[i] = state
        state = came_from[i, 1] if state else came_from[i, 0]
