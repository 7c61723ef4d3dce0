"""Rows of numbers as text."""

import numpy as np

from posefuse.io.number_rows import number_rows


def test_numbers_have_their_decimals_and_missing_ones_are_empty():
    values = np.array([[1.0, 0.5, np.nan], [2.0, -0.25, 12.3456789]])
    assert number_rows(values, np.array([0, 1, 6]), "\t") == b"1\t0.5\t\n2\t-0.3\t12.345679\n"
    assert number_rows(values[:, :2], 3, " ") == b"1 0.5\n2 -0.25\n"


def test_rows_without_cells_are_empty_lines():
    assert number_rows(np.empty((2, 0)), 3, " ") == b"\n\n"
    assert number_rows(np.empty((0, 2)), 3, " ") == b""


def test_numbers_of_any_size_are_written():
    lines = number_rows(np.array([[1e30, np.nan, np.inf], [0.5, 1.0, -np.inf]]), 2, " ").decode().split("\n")
    assert float(lines[0].split(" ")[0]) == 1e30
    assert lines[0].split(" ")[1:] == ["", "inf"]
    assert lines[1] == "0.50 1.00 -inf"
