"""Import of pyarrow, the optional dependency for parquet (extra ``parquet``), and conversion of its tables."""

from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.columns import Column, Columns, Words


def import_pyarrow() -> Any:
    """Return the module ``pyarrow`` with its submodules ``parquet`` and ``compute``.

    Raises:
        FileError: if it is not installed.
    """
    try:
        import pyarrow.compute
        import pyarrow.parquet
    except ImportError:
        raise FileError(
            "Parquet files need pyarrow, which is not installed. Run: pip install 'posefuse[parquet]'."
        ) from None
    return pyarrow


def numbers_in(values: Any, default: int | None = None) -> np.ndarray:
    """Return a column or an array of pyarrow as a NumPy array.

    Numbers without null are taken from memory as they are: pyarrow's own conversion imports pandas where that is
    installed, which takes most of a second.

    Args:
        values: the column or array.
        default: replaces null; None leaves it to pyarrow, which returns NaN.
    """
    types, kind, whole = import_pyarrow().types, values.type, values.null_count == 0
    if not (whole and (types.is_integer(kind) or types.is_floating(kind))):
        filled = values if default is None or whole else values.fill_null(default)
        return filled.to_numpy(zero_copy_only=False)
    dtype, parts = np.dtype(kind.to_pandas_dtype()), getattr(values, "chunks", [values])
    pieces = [
        np.frombuffer(part.buffers()[1], dtype, len(part), part.offset * dtype.itemsize) for part in parts if len(part)
    ]
    return pieces[0] if len(pieces) == 1 else np.concatenate([np.empty(0, dtype), *pieces])


def arrow_table(columns: Columns, *, coded_words: bool) -> Any:
    """Return columns as a table of pyarrow; words with a dictionary, if ``coded_words``, or as plain strings."""
    pa = import_pyarrow()

    def array(column: Column) -> Any:
        if not isinstance(column, Words):
            return pa.array(np.ma.getdata(column), mask=np.ma.getmaskarray(column) | np.isnan(np.ma.getdata(column)))
        indices = pa.array(column.codes.astype(np.int32), pa.int32(), mask=column.codes < 0)
        coded = pa.DictionaryArray.from_arrays(indices, pa.array(list(column.names), pa.string()))
        return coded if coded_words else coded.cast(pa.string())

    return pa.table({name: array(column) for name, column in columns.items()})


def columns_of(path: Path, table: Any, *, words: Container[str], numbers: Container[str]) -> dict[str, Column]:
    """Return columns of words and of numbers of a table of pyarrow; other columns are left out.

    Raises:
        FileError: if a column has another type.
    """
    names = [name for name in table.column_names if name in words or name in numbers]
    return {name: (_words if name in words else _numbers)(path, table.column(name), name) for name in names}


def _words(path: Path, column: Any, name: str) -> Words:
    pa = import_pyarrow()
    try:
        coded = column.cast(pa.string()).combine_chunks().dictionary_encode()
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError, pa.ArrowTypeError) as error:
        raise FileError(f"{path}: the column {name} does not contain names: {error}.") from None
    codes = coded.indices.fill_null(-1).to_numpy(zero_copy_only=False)
    return Words(codes.astype(np.int64), tuple(coded.dictionary.to_pylist()))


def _numbers(path: Path, column: Any, name: str) -> np.ndarray:
    pa = import_pyarrow()
    try:
        return np.array(column.cast(pa.float64()).to_numpy(zero_copy_only=False), dtype=np.float64)
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError, pa.ArrowTypeError, ValueError, TypeError) as error:
        raise FileError(f"{path}: the column {name} does not contain numbers: {error}.") from None
