"""Arrays that stay in their files and are read by ranges of rows."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np


class RowsByRange(ABC):
    """An array with one row per person that is read by ranges of rows.

    Args:
        shape: Shape of the whole array.
        dtype: Type of its numbers.
    """

    def __init__(self, shape: tuple[int, ...], dtype: type = np.float64) -> None:
        self.shape, self.dtype = shape, np.dtype(dtype)

    @abstractmethod
    def rows(self, start: int, stop: int) -> np.ndarray:
        """Return the rows from ``start`` up to but excluding ``stop``, both within the array."""

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: Any) -> np.ndarray:
        if isinstance(key, slice):
            start, stop, step = key.indices(len(self))
            return self._range(start, max(stop, start))[::step]
        indices = np.asarray(key)
        if indices.dtype == bool:
            indices = np.flatnonzero(indices)
        if not indices.size:
            return np.empty((*indices.shape, *self.shape[1:]), dtype=self.dtype)
        if indices.min() < -len(self) or indices.max() >= len(self):
            raise IndexError(f"Index {key} is out of bounds for {len(self)} rows.")
        indices = np.where(indices < 0, indices + len(self), indices)
        low = int(indices.min())
        return self._range(low, int(indices.max()) + 1)[indices - low]

    def _range(self, start: int, stop: int) -> np.ndarray:
        if stop <= start:
            return np.empty((0, *self.shape[1:]), dtype=self.dtype)
        return self.rows(start, stop)
