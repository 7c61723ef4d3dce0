"""Rows of numbers as text, for tables of other programs."""

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.tables.rows import MAX_SCALED, NUMBER_BYTES, NumberCells, WordCells, write_rows

# The text is read-only like that of words, so that the kernel is compiled once.
_NO_WORDS = frozen(np.zeros(1), np.uint8), np.zeros(1, dtype=np.int64)


def number_rows(values: np.ndarray, decimals: int | np.ndarray, separator: str) -> bytes:
    """Return rows of numbers as lines of text; zeros at the end of decimals are left out, and NaN is an empty cell.

    Args:
        values: shape (row, column).
        decimals: number of decimals of all columns, or shape (column,).
        separator: character between cells.
    """
    rows, columns = values.shape
    if not rows or not columns:
        return b"\n" * rows
    places = np.broadcast_to(np.asarray(decimals, dtype=np.int64), (columns,))
    with np.errstate(invalid="ignore", over="ignore"):
        fits = (np.abs(values) * 10.0**places < MAX_SCALED) | np.isnan(values)
    if not fits.all():
        lines = (separator.join(map(_number, row, places)) for row in values)
        return "".join(f"{line}\n" for line in lines).encode()
    decimals_of_cells = np.repeat(places[:, None], rows, axis=1)
    cells = NumberCells(np.ascontiguousarray(values.T, dtype=np.float64), decimals_of_cells)
    words = WordCells(np.zeros((0, rows), dtype=np.int64), *_NO_WORDS)
    out = np.empty(rows * columns * (NUMBER_BYTES + 1), dtype=np.uint8)
    size = write_rows(cells, words, np.arange(columns), ord(separator), out)
    return out[:size].tobytes()


def _number(value: float, decimals: int) -> str:
    """Return a number of any size."""
    return "" if np.isnan(value) else f"{value:.{decimals}f}"
