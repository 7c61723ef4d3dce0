"""Checks of untrusted parquet files before they are read: run-length encoding stores many rows in few bytes."""

from pathlib import Path
from typing import Any

from posefuse.io.arrow import import_pyarrow
from posefuse.io.files import check_unpacked_size, max_unpacked_bytes
from posefuse.io.parquet_footer import row_groups

_VALUE_BYTES = {"BOOLEAN": 1, "INT32": 4, "FLOAT": 4, "INT96": 12, "BYTE_ARRAY": 16}
_DEFAULT_VALUE_BYTES = 8


def check_parquet(path: Path) -> None:
    """Check a file that is read completely.

    Raises:
        FileError: If it is a decompression bomb.
        Exception: Any exception that the library raises on a broken file.
    """
    check_unpacked_size(path, sum(_group_bytes(path)))
    check_unpacked_size(path, sum(_string_bytes(path)))


def check_row_groups(path: Path) -> None:
    """Check a file that is read one row group at a time.

    Raises:
        FileError: If a row group is a decompression bomb.
        Exception: Any exception that the library raises on a broken file.
    """
    check_unpacked_size(path, max(_group_bytes(path), default=0))
    check_unpacked_size(path, max(_string_bytes(path), default=0))


def _group_bytes(path: Path) -> list[int]:
    """Return the size of each row group in memory, as stated by the footer."""
    sizes = []
    for group in row_groups(path):
        values = sum(
            column.n_values * _VALUE_BYTES.get(column.physical_type, _DEFAULT_VALUE_BYTES) for column in group.columns
        )
        sizes.append(max(values, group.uncompressed_bytes))
    return sizes


def _string_bytes(path: Path) -> list[int]:
    """Return the size of the strings of each row group that may be a bomb: every row may refer to one long string.

    Strings are read as they are stored, a dictionary and indices into it.
    """
    pq = import_pyarrow().parquet
    sizes = []
    with pq.ParquetFile(path) as plain:
        flat_names = plain.schema_arrow.names
    for g, group in enumerate(row_groups(path)):
        strings = [column for column in group.columns if column.physical_type == "BYTE_ARRAY"]
        upper_bound = sum(column.n_values * column.uncompressed_bytes for column in strings)
        if upper_bound <= max_unpacked_bytes(path):
            continue
        flat = [column.path for column in strings if column.path in flat_names]
        with pq.ParquetFile(path, read_dictionary=flat) as content:
            table = content.read_row_group(g, columns=flat)
            sizes.append(sum(_expanded_bytes(chunk) for column in table.columns for chunk in column.chunks))
    return sizes


def _expanded_bytes(chunk: Any) -> int:
    """Return the number of bytes that the strings of a column take when each row stores its own."""
    pa = import_pyarrow()
    if not pa.types.is_dictionary(chunk.type):
        return chunk.nbytes
    lengths = pa.compute.call_function("binary_length", [chunk.dictionary]).fill_null(0)
    if not len(lengths):
        return 0
    counts = chunk.indices.drop_null().value_counts()
    used = lengths.take(counts.field("values"))
    return int(sum(a * b for a, b in zip(used.to_pylist(), counts.field("counts").to_pylist(), strict=True)))
