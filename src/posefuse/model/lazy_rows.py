"""Selected rows of an array that may stay in its file."""

from typing import Any

import numpy as np

from posefuse.arrays import ArraySource, in_memory


class ChosenRows:
    """Selected rows of an array in a file, read on access; each access reads one contiguous range.

    Args:
        source: array.
        rows: shape (row,), int64: indices of the rows, nearly sorted.
    """

    def __init__(self, source: ArraySource, rows: np.ndarray) -> None:
        self._source, self._rows = source, rows
        self.shape = (len(rows), *source.shape[1:])
        self.dtype = source.dtype

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, key: Any) -> np.ndarray:
        selected = self._rows[key]
        if np.size(selected) == 0:
            return np.asarray(self._source[0:0])
        low = int(np.min(selected))
        return np.asarray(self._source[low : int(np.max(selected)) + 1])[selected - low]


def chosen_rows(source: ArraySource, rows: np.ndarray) -> ArraySource:
    """Return selected rows of an array: in memory if the array is, otherwise read on access."""
    return np.asarray(source)[rows] if in_memory(source) else ChosenRows(source, rows)
