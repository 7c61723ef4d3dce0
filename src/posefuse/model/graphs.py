"""Best assignment and connected components of small graphs, without the import of SciPy, which takes 0.2 s.

Results are those of SciPy, also where several are equally good.
"""

import math

import numpy as np


def best_assignment(cost: np.ndarray) -> list[tuple[int, int]]:
    """Return the pairs of rows and columns with the smallest sum of costs, by row; min(rows, columns) pairs.

    One row after the other is added along a shortest augmenting path (Crouse 2016).

    Args:
        cost: shape (row, column); inf where a pair is not allowed.

    Raises:
        ValueError: if a cost is NaN or minus infinity, or if no assignment has a finite cost.
    """
    if not (cost > -np.inf).all():
        raise ValueError("The matrix of costs contains NaN or minus infinity.")
    n_rows, n_columns = cost.shape
    if n_rows > n_columns:
        return sorted((row, column) for column, row in best_assignment(cost.T))
    search = _Search(cost.tolist(), n_columns)
    for row in range(n_rows):
        search.add(row)
    return list(enumerate(search.column_of))


class _Search:
    """Assignment of rows, of which there are at most as many as columns.

    Attributes:
        column_of: column of each row, -1 if not assigned yet.
    """

    def __init__(self, cost: list[list[float]], n_columns: int) -> None:
        self.column_of = [-1] * len(cost)
        self._row_of = [-1] * n_columns
        self._cost = cost
        self._row_potentials = [0.0] * len(cost)
        self._column_potentials = [0.0] * n_columns

    def add(self, row: int) -> None:
        """Assign one more row, and reassign others."""
        shortest, previous = [math.inf] * len(self._row_of), [-1] * len(self._row_of)
        reached, lowest = self._reach(row, shortest, previous)
        self._row_potentials[row] += lowest
        for column in reached[:-1]:
            self._row_potentials[self._row_of[column]] += lowest - shortest[column]
        for column in reached:
            self._column_potentials[column] -= lowest - shortest[column]
        column, at = reached[-1], -1
        while at != row:
            at = previous[column]
            self._row_of[column] = at
            column, self.column_of[at] = self.column_of[at], column

    def _reach(self, row: int, shortest: list[float], previous: list[int]) -> tuple[list[int], float]:
        """Search the shortest path to a free column.

        Args:
            row: row to assign.
            shortest: by column, the length of the shortest path; updated.
            previous: by column, the row before it; updated.

        Returns:
            Columns in the order in which they are reached, and the length of the path.
        """
        row_of, potentials = self._row_of, self._column_potentials
        # In reverse order, so that equal costs give the columns in their order.
        remaining, reached, lowest = list(range(len(row_of)))[::-1], [], 0.0
        while True:
            cost, potential, start = self._cost[row], self._row_potentials[row], lowest
            place, lowest = -1, math.inf
            for here, column in enumerate(remaining):
                length = start + cost[column] - potential - potentials[column]
                if length < shortest[column]:
                    previous[column], shortest[column] = row, length
                if shortest[column] < lowest or (shortest[column] == lowest and row_of[column] < 0):
                    place, lowest = here, shortest[column]
            if math.isinf(lowest):
                raise ValueError("No assignment has a finite cost.")
            column = remaining[place]
            reached.append(column)
            if row_of[column] < 0:
                return reached, lowest
            row, remaining[place] = row_of[column], remaining[-1]
            remaining.pop()


def connected_components(joined: np.ndarray) -> np.ndarray:
    """Return the component of each node, shape (node,), int64, numbered in the order of their first nodes.

    Args:
        joined: shape (node, node), bool: whether two nodes are joined, in either direction.
    """
    either = joined | joined.T
    labels = np.full(len(joined), -1)
    count = 0
    for node in range(len(joined)):
        if labels[node] >= 0:
            continue
        new = np.zeros(len(joined), dtype=bool)
        new[node] = True
        while new.any():
            labels[new] = count
            new = either[new].any(axis=0) & (labels < 0)
        count += 1
    return labels
