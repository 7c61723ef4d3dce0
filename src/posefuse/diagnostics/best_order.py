"""Assign cameras to views at the lowest total cost."""

from itertools import combinations, permutations

import numpy as np

_MAX_PERMUTED_VIEWS = 7
_MAX_SWAPS = 200
"""Bound of the swaps of cameras; each lowers the cost, and a few undo any exchange."""


def best_order(costs: np.ndarray, start: tuple[int, ...]) -> tuple[int, ...]:
    """Return the assignment of cameras to views with the lowest total cost; ``start`` if no cost is known."""
    if not np.isfinite(costs).any():
        return start
    views = len(costs)
    known = np.where(np.isfinite(costs), costs, np.nanmean(costs))

    def total(order: tuple[int, ...]) -> float:
        return sum(known[a, order[a], b, order[b]] for a, b in combinations(range(views), 2))

    best = start
    if views <= _MAX_PERMUTED_VIEWS:
        orders = np.array(list(permutations(range(views))))
        sums = sum(known[a, orders[:, a], b, orders[:, b]] for a, b in combinations(range(views), 2))
        cheapest = tuple(int(c) for c in orders[int(np.argmin(sums))])
        return cheapest if total(cheapest) < total(start) - 1e-9 else start
    for _ in range(_MAX_SWAPS):
        swaps = []
        for a, b in combinations(range(views), 2):
            order = list(best)
            order[a], order[b] = order[b], order[a]
            swaps.append(tuple(order))
        cheapest = min(swaps, key=total)
        if total(cheapest) >= total(best) - 1e-9:
            return best
        best = cheapest
    return best
