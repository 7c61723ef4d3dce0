"""Assignments and components equal those of SciPy, also where several are equally good."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csgraph

from posefuse.model.graphs import best_assignment, connected_components

FORBIDDEN = 1e6


def costs(kind: str, rng: np.random.Generator) -> np.ndarray:
    """Return a random matrix of costs."""
    shape = rng.integers(0, 9, 2)
    if kind == "equal costs":
        return rng.integers(0, 4, shape).astype(float)
    cost = rng.normal(size=shape)
    cost[rng.random(shape) < 0.4] = {"different costs": 0.5, "large costs": FORBIDDEN, "infinite costs": np.inf}[kind]
    return cost


@pytest.mark.parametrize("kind", ["different costs", "equal costs", "large costs", "infinite costs"])
def test_assignment_is_that_of_scipy(kind):
    rng = np.random.default_rng(0)
    failed = 0
    for _ in range(500):
        cost = costs(kind, rng)
        try:
            expected = list(zip(*(each.tolist() for each in linear_sum_assignment(cost)), strict=True))
        except ValueError:
            failed += 1
            with pytest.raises(ValueError, match="finite"):
                best_assignment(cost)
        else:
            assert best_assignment(cost) == expected
    assert (failed > 0) == (kind == "infinite costs")


@pytest.mark.parametrize("wrong", [np.nan, -np.inf])
def test_costs_must_be_numbers(wrong):
    with pytest.raises(ValueError, match="NaN or minus infinity"):
        best_assignment(np.array([[1.0, wrong]]))


@pytest.mark.parametrize("density", [0.0, 0.05, 0.15, 1.0])
def test_components_are_those_of_scipy(density):
    rng = np.random.default_rng(0)
    for nodes in (0, 1, 2, 5, 20, 60):
        joined = rng.random((nodes, nodes)) < density
        expected = csgraph.connected_components(joined, directed=False)[1] if nodes else []
        np.testing.assert_array_equal(connected_components(joined), expected)
