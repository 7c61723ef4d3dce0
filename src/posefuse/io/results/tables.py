"""Reading of tables: CSV columns of given types, and conversion of columns to arrays."""

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import csv as arrow_csv

from posefuse.errors import FileError
from posefuse.io.files import reading

_MAX_EXACT = 2.0**53


def header(path: Path) -> list[str]:
    """Return the first row of a CSV file.

    Raises:
        FileError: if the file cannot be read as CSV.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as lines:
            return next(csv.reader(lines), [])
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{path} is not a UTF-8 CSV file: {error}.") from None
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}.") from None


def read_csv(path: Path, kinds: Mapping[str, pa.DataType]) -> pa.Table:
    """Read a CSV file; columns that are not in ``kinds`` are left out.

    Raises:
        FileError: if a row is incomplete, or a cell does not have the type of its column.
    """
    names = header(path)
    if len(set(names)) != len(names):
        raise FileError(f"{path} has a duplicate column name in its first row.")
    with reading(path, "CSV file"):
        return arrow_csv.read_csv(
            path,
            arrow_csv.ReadOptions(use_threads=False),
            arrow_csv.ParseOptions(newlines_in_values=True),
            arrow_csv.ConvertOptions(
                column_types=dict(kinds),
                include_columns=[name for name in names if name in kinds],
                null_values=["", "nan", "NaN"],
                strings_can_be_null=False,
            ),
        )


def numbers(column: pa.ChunkedArray) -> np.ndarray:
    """Return a column of shape (row,), float64, NaN for empty cells."""
    return np.array(column.cast(pa.float64()).to_numpy(), dtype=np.float64)


def words(column: pa.ChunkedArray) -> np.ndarray:
    """Return a column of strings, shape (row,), empty for empty cells."""
    return np.array(["" if word is None else word for word in column.to_pylist()], dtype=object)


def whole(values: np.ndarray, path: Path, what: str) -> np.ndarray:
    """Convert numbers to int64.

    Raises:
        FileError: if some are missing or not integers.
    """
    fits = np.isfinite(values) & (values == np.round(values)) & (np.abs(values) < _MAX_EXACT)
    if not fits.all():
        raise FileError(f"{path}: {what} must be whole numbers, got {values[~fits][0]:g}.")
    return values.astype(np.int64)


def counts(values: np.ndarray, path: Path) -> np.ndarray:
    """Return numbers of views, int64; 0 for missing ones.

    Raises:
        FileError: if some are not integers.
    """
    return whole(np.nan_to_num(values, nan=0.0), path, "numbers of views")


def increasing(frame_numbers: np.ndarray, path: Path) -> np.ndarray:
    """Return the frame numbers after checking that they increase.

    Raises:
        FileError: if they do not increase.
    """
    steps = np.diff(frame_numbers)
    if (steps <= 0).any():
        at = int(np.argmax(steps <= 0))
        raise FileError(
            f"{path}: frame {frame_numbers[at]} comes before {frame_numbers[at + 1]}; frames must increase."
        )
    return frame_numbers


def in_order(names: np.ndarray) -> tuple[str, ...]:
    """Return the distinct names in order of first occurrence."""
    return tuple(dict.fromkeys(names.tolist()))
