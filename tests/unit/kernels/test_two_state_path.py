"""The path of two states against all paths."""

from itertools import product

import numpy as np

from posefuse.kernels.calibration.two_state_path import two_state_path


def test_path_is_the_best_of_all(rng):
    for _ in range(20):
        gain, cost = rng.standard_normal(8), rng.uniform(0.0, 2.0, 8)
        path = np.empty(8, dtype=bool)
        two_state_path(gain, cost, path)

        def value(states, gain=gain, cost=cost):
            states = np.array(states, dtype=bool)
            return gain[states].sum() - cost[1:][states[1:] != states[:-1]].sum()

        assert value(path) == max(value(states) for states in product((False, True), repeat=8))
