"""Arrays that stay in their files, whatever the files are: read by ranges of rows, never whole."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np


class RowsByRange(ABC):
    """An array of a row a person, of which a range of rows at a time is read.

    Args:
        shape: of the whole array.
        dtype: of its numbers.
    """

    def __init__(self, shape: tuple[int, ...], dtype: type = np.float64) -> None:
        self.shape, self.dtype = shape, np.dtype(dtype)

    @abstractmethod
    def rows(self, start: int, stop: int) -> np.ndarray:
        """The rows from ``start`` to before ``stop``, both within the array."""

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: Any) -> np.ndarray:
        if isinstance(key, slice):
            start, stop, step = key.indices(len(self))
            return self._range(start, max(stop, start))[::step]
        chosen = np.asarray(key)
        if chosen.dtype == bool:
            chosen = np.flatnonzero(chosen)
        if not chosen.size:
            return np.empty((*chosen.shape, *self.shape[1:]), dtype=self.dtype)
        if chosen.min() < -len(self) or chosen.max() >= len(self):
            raise IndexError(f"There are {len(self)} rows, none {key}.")
        chosen = np.where(chosen < 0, chosen + len(self), chosen)
        low = int(chosen.min())
        return self._range(low, int(chosen.max()) + 1)[chosen - low]

    def _range(self, start: int, stop: int) -> np.ndarray:
        if stop <= start:
            return np.empty((0, *self.shape[1:]), dtype=self.dtype)
        return self.rows(start, stop)
