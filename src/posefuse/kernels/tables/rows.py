"""Rows of CSV tables: numbers with a fixed number of decimals, and words, as bytes."""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.jit import kernel, subroutine

MAX_DECIMALS = 12
"""Largest number of decimals of a number."""

MAX_SCALED = 2.0**62
"""Numbers times ten to the power of their decimals are below this."""

NUMBER_BYTES = 22
"""Largest length of a number: sign, point, and the digits of 2^62."""

_POINT, _MINUS, _ZERO, _LINE_FEED = 46, 45, 48, 10


class NumberCells(NamedTuple):
    """Columns of numbers.

    Attributes:
        values: shape (column, row): finite, or NaN for an empty cell.
        decimals: shape (column, row), int64, 0 to MAX_DECIMALS: number of decimals; zeros at the end are left out.
    """

    values: Any
    decimals: Any


class WordCells(NamedTuple):
    """Columns of words.

    Attributes:
        codes: shape (column, row), int64: number of the word in each cell.
        text: bytes of all words, one after the other.
        starts: shape (word + 1,), int64: where each word begins in the text.
    """

    codes: Any
    text: Any
    starts: Any


@subroutine
def _write_number(value, decimals, out, at):
    """Write a number at a position, rounded to its decimals; return the position after it."""
    if math.isnan(value):
        return at
    scale = 1.0
    for _ in range(decimals):
        scale *= 10.0
    whole = np.int64(math.floor(abs(value) * scale + 0.5))
    while decimals > 0 and whole % 10 == 0:
        whole //= 10
        decimals -= 1
    if value < 0.0 and whole > 0:
        out[at] = _MINUS
        at += 1
    digits = 1
    rest = whole // 10
    while rest > 0:
        rest //= 10
        digits += 1
    digits = max(digits, decimals + 1)
    length = digits + (1 if decimals > 0 else 0)
    for n in range(length):
        place = at + length - 1 - n
        if decimals > 0 and n == decimals:
            out[place] = _POINT
        else:
            out[place] = _ZERO + whole % 10
            whole //= 10
    return at + length


@kernel
def write_rows(numbers, words, order, separator, out):
    """Write all rows, with a separator between cells and a line feed after each row; return the number of bytes.

    Args:
        numbers: NumberCells.
        words: WordCells.
        order: shape (column,), int64: for each column of the table, the column of numbers ``n`` as ``n`` or the column
            of words ``n`` as ``-1 - n``.
        separator: byte between cells.
        out: bytes, written: long enough for all cells.
    """
    at = 0
    for row in range(numbers.values.shape[1]):
        for column in range(order.shape[0]):
            source = order[column]
            if source >= 0:
                at = _write_number(numbers.values[source, row], numbers.decimals[source, row], out, at)
            else:
                word = words.codes[-1 - source, row]
                for n in range(words.starts[word], words.starts[word + 1]):
                    out[at] = words.text[n]
                    at += 1
            out[at] = separator
            at += 1
        out[at - 1] = _LINE_FEED
    return at
