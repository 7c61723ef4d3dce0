"""Pairs of residuals."""

import numpy as np

from posefuse.noise.leave_one_out import choose_pairs


def test_pairs_stay_within_their_piece():
    """A pair joins a point with the next frame if that is informative and in the same piece."""
    telling = np.ones((6, 1, 2), dtype=bool)
    telling[1, 0, 0] = False
    pairs = choose_pairs(telling, (0, 4), 100).reshape(-1, 2).tolist()
    assert pairs == [[0, 0], [1, 3], [3, 5], [4, 6], [5, 7], [6, 6], [7, 7], [8, 10], [9, 11], [10, 10], [11, 11]]
    few = choose_pairs(telling, (0, 4), 2).reshape(-1, 2)[:, 0].tolist()
    assert few == [0, 7, 8, 11]
    assert choose_pairs(np.zeros((3, 1, 2), dtype=bool), (0, 1), 5).tolist() == []
