"""Some rows of an array that stays where it is."""

from typing import Any

import numpy as np

from posefuse.arrays import ArraySource, in_memory


class ChosenRows:
    """Rows of an array in a file, read when they are asked for; rows that are near each other in it at once.

    Args:
        source: the array.
        rows: shape (row,), int64: which of its rows, nearly in order.
    """

    def __init__(self, source: ArraySource, rows: np.ndarray) -> None:
        self._source, self._rows = source, rows
        self.shape = (len(rows), *source.shape[1:])
        self.dtype = source.dtype

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, key: Any) -> np.ndarray:
        wanted = self._rows[key]
        if np.size(wanted) == 0:
            return np.asarray(self._source[0:0])
        low = int(np.min(wanted))
        return np.asarray(self._source[low : int(np.max(wanted)) + 1])[wanted - low]


def chosen_rows(source: ArraySource, rows: np.ndarray) -> ArraySource:
    """Some rows of an array: in memory if it is, else read when they are asked for."""
    return np.asarray(source)[rows] if in_memory(source) else ChosenRows(source, rows)
