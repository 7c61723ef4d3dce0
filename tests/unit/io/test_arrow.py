"""Conversion of columns to tables of pyarrow, and its absence."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from posefuse.errors import FileError
from posefuse.io.arrow import arrow_table, columns_of, import_pyarrow, numbers_in
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


@pytest.mark.parametrize("kind", ["int32", "int64", "uint8", "float32", "float64", "float16"])
@pytest.mark.parametrize("chunked", [False, True])
@pytest.mark.parametrize("missing", [False, True])
def test_numbers_are_those_of_pyarrow(kind, chunked, missing):
    pa = import_pyarrow()
    numbers = pa.array([1, 0, None if missing else 1, 1, 0, 0], pa.int8()).cast(pa.from_numpy_dtype(np.dtype(kind)))
    values = numbers[1:5]
    if chunked:
        values = pa.chunked_array([numbers[1:2], numbers[:0], numbers[2:5]])
    default = 0 if missing else None
    expected = values.to_pylist() if default is None else [default if v is None else v for v in values.to_pylist()]
    found = numbers_in(values, default)
    assert found.dtype == kind
    assert found.tolist() == expected
    assert len(numbers_in(values[:0])) == 0


def test_numbers_without_null_do_not_import_pandas():
    code = (
        "import sys, numpy, pyarrow; from posefuse.io.arrow import numbers_in; "
        "buffer = pyarrow.py_buffer(numpy.arange(3.0)); "
        "values = pyarrow.Array.from_buffers(pyarrow.float64(), 3, [None, buffer]); "
        "assert numbers_in(values).tolist() == [0, 1, 2]; assert 'pandas' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
