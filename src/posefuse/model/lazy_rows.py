"""Selected rows of an array that may stay in its file."""

import numpy as np

from posefuse.arrays import ArraySource, in_memory
from posefuse.lazy_array import LazyArray, as_array


class ChosenRows(LazyArray):
    """Selected rows of an array in a file, read on access; each access reads one contiguous range.

    Args:
        source: array.
        rows: shape (row,), int64: indices of the rows, nearly sorted.
    """

    def __init__(self, source: ArraySource, rows: np.ndarray) -> None:
        super().__init__((len(rows), *source.shape[1:]), source.dtype)
        self._source, self._indices = source, rows

    def read_rows(self, start: int, stop: int) -> np.ndarray:
        """Read rows."""
        chosen = self._indices[start:stop]
        low = int(chosen.min())
        return np.asarray(self._source[low : int(chosen.max()) + 1])[chosen - low]


def chosen_rows(source: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return selected rows of an array: in memory if the array is, otherwise read on access."""
    return np.asarray(source)[rows] if in_memory(source) else as_array(ChosenRows(source, rows))
