"""Tables as columns: numbers, and words as codes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

_MAX_EXACT = 2.0**53


@dataclass(frozen=True)
class Words:
    """A column of words, each of which is stored once.

    Attributes:
        codes: shape (row,): index of each cell's word in ``names``, -1 for an empty cell.
        names: the distinct words.
    """

    codes: np.ndarray
    names: tuple[str, ...]

    @classmethod
    def of(cls, values: Sequence[Any] | np.ndarray) -> "Words":
        """Return the column of given words; None is an empty cell."""
        index: dict[Any, int] = {}
        codes = [-1 if word is None else index.setdefault(word, len(index)) for word in values]
        return cls(np.array(codes, dtype=np.int64), tuple(map(str, index)))

    def values(self) -> np.ndarray:
        """Return the words, shape (row,), object; an empty cell is the empty string."""
        return np.array([*self.names, ""], dtype=object)[self.codes]

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.codes)

    def __getitem__(self, rows: Any) -> "Words":
        """Return the cells of some rows."""
        return Words(self.codes[rows], self.names)


@dataclass(frozen=True)
class Decimals:
    """A column of numbers that are written with a limited number of decimals.

    Attributes:
        values: shape (row,), NaN for an empty cell.
        decimals: shape (row,), int64: number of decimals of each cell; one number applies to all.
    """

    values: np.ndarray
    decimals: np.ndarray | int

    def rounded(self) -> np.ndarray:
        """Return the rounded numbers, shape (row,); numbers too large for their decimals remain."""
        scale = 10.0**self.decimals
        with np.errstate(invalid="ignore", over="ignore"):
            scaled = self.values * scale
            return np.where(np.abs(scaled) < _MAX_EXACT, np.round(scaled) / scale, self.values)

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.values)


Column = np.ndarray | Words
"""Shape (row,). An empty cell is NaN in floats, masked in integers (``np.ma``), and the code -1 in words."""

Columns = Mapping[str, Column]
"""Columns of equal length by name."""


def n_rows(columns: Columns) -> int:
    """Return the number of rows."""
    return len(next(iter(columns.values()), ()))


def number_column(columns: Columns, name: str) -> np.ndarray:
    """Return a column of numbers, shape (row,)."""
    column = columns[name]
    assert not isinstance(column, Words)
    return column


def word_column(columns: Columns, name: str) -> np.ndarray:
    """Return the words of a column, shape (row,), object."""
    column = columns[name]
    assert isinstance(column, Words)
    return column.values()
