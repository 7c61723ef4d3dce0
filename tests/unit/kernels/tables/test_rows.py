"""Rows of tables as text."""

from decimal import ROUND_HALF_UP, Decimal

import numpy as np
import pytest

from posefuse.kernels.tables.rows import NumberCells, WordCells, write_rows

pytestmark = pytest.mark.no_jit


def reference_number(value: float, decimals: int) -> str:
    """Return a number with so many decimals, without zeros at the end."""
    if np.isnan(value):
        return ""
    exact = Decimal(value).quantize(Decimal(1).scaleb(-int(decimals)), ROUND_HALF_UP)
    text = f"{exact:f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text == "-0" else text


def written(values, decimals, words, codes, order):
    """Return the text of rows of numbers, shape (column, row), and words."""
    starts = np.concatenate([[0], np.cumsum([len(word) for word in words])]).astype(np.int64)
    text = np.frombuffer("".join(words).encode() or b" ", dtype=np.uint8)
    out = np.zeros(100 * values.shape[1] * len(order), dtype=np.uint8)
    size = write_rows(NumberCells(values, decimals), WordCells(codes, text, starts), np.array(order), ord(","), out)
    return out[:size].tobytes().decode()


def test_numbers_equal_those_of_decimal_arithmetic():
    rng = np.random.default_rng(0)
    decimals = rng.integers(0, 10, (2, 300))
    values = rng.normal(size=(2, 300)) * 10.0 ** rng.integers(-8, 6, (2, 300))
    values[0, :6] = [0.0, -0.0, np.nan, 1.0, -10.0, 0.05]
    lines = written(values, decimals, [""], np.zeros((0, 300), dtype=np.int64), [1, 0]).splitlines()
    for row, line in enumerate(lines):
        expected = [reference_number(values[i, row], decimals[i, row]) for i in (1, 0)]
        for cell, text, number, places in zip(
            line.split(","), expected, values[::-1, row], decimals[::-1, row], strict=True
        ):
            # Where a binary number lies within rounding of a tie, either neighbor is the nearest.
            if cell != text:
                assert abs(float(cell) - number) <= 0.5 * 10.0 ** -int(places) * (1.0 + 1e-9)


def test_words_are_between_numbers_in_the_order_of_the_table():
    values = np.array([[1.5, np.nan, -2.0]])
    codes = np.array([[1, 0, 2], [2, 2, 1]])
    text = written(values, np.full((1, 3), 2), ["", '"a"', '"bc"'], codes, [-1, 0, -2])
    assert text == '"a",1.5,"bc"\n,,"bc"\n"bc",-2,"a"\n'
