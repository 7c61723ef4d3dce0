"""Conversion of columns to tables of pyarrow, and its absence."""

import sys
from pathlib import Path

import numpy as np
import pytest

from posefuse.errors import FileError
from posefuse.io.arrow import arrow_table, columns_of, import_pyarrow
from posefuse.io.columns import Words


@pytest.mark.parametrize("coded", [True, False])
def test_columns_survive(coded):
    table = arrow_table({"x": np.array([1.5, np.nan]), "w": Words.of(["a", None])}, coded_words=coded)
    assert table["x"].to_pylist() == [1.5, None]
    found = columns_of(Path("f"), table, words=("w",), numbers=("x",))
    np.testing.assert_array_equal(found["x"], [1.5, np.nan])
    assert found["w"].values().tolist() == ["a", ""]


def test_columns_of_another_type_are_refused():
    table = import_pyarrow().table({"x": ["a"]})
    with pytest.raises(FileError, match="the column x does not contain numbers"):
        columns_of(Path("f"), table, words=(), numbers=("x",))


def test_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(FileError, match=r"pip install 'posefuse\[parquet\]'"):
        import_pyarrow()
