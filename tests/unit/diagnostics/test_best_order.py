"""Search for the assignment of cameras to views."""

import numpy as np
import pytest

from posefuse.diagnostics.best_order import best_order


def costs_of(true_order: list[int]) -> np.ndarray:
    """Return costs of 0 for the true assignment and 1 for any other, shape (view, camera, view, camera)."""
    right = np.eye(len(true_order), dtype=bool)[true_order]
    return np.where(right[:, :, None, None] & right[None, None], 0.0, 1.0)


@pytest.mark.parametrize("true_order", [[0, 2, 1, 3], [0, 1, 2, 3, 4, 8, 6, 7, 5], list(range(9))])
def test_assignment_with_the_lowest_cost_is_found(true_order):
    start = tuple(range(len(true_order)))
    assert best_order(costs_of(true_order), start) == tuple(true_order)


@pytest.mark.parametrize("views", [4, 12])
def test_without_a_known_cost_the_assignment_stays(views):
    start = tuple(range(views))
    assert best_order(np.full((views,) * 4, np.nan), start) == start
