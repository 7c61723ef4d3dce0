"""Parquet files of anybody's, looked at before they are read: a run of one value is as short as its length is long."""

from pathlib import Path
from typing import Any

from posefuse.io.files import most_unfolded, must_unfold

_WIDTHS = {"BOOLEAN": 1, "INT32": 4, "FLOAT": 4, "INT96": 12, "BYTE_ARRAY": 16}
_WIDEST = 8


def check_parquet(path: Path) -> None:
    """Look at a file that is read whole.

    Raises:
        FileError: if it is a bomb.
        Exception: what the library raises where it is broken.
    """
    must_unfold(path, sum(_group_bytes(path)))
    must_unfold(path, sum(_text_bytes(path)))


def check_row_groups(path: Path) -> None:
    """Look at a file that is read a row group at a time.

    Raises:
        FileError: if one of them is a bomb.
        Exception: what the library raises where it is broken.
    """
    must_unfold(path, max(_group_bytes(path), default=0))
    must_unfold(path, max(_text_bytes(path), default=0))


def _group_bytes(path: Path) -> list[int]:
    """Bytes of each row group in memory, as far as its description tells."""
    import pyarrow.parquet as pq

    metadata = pq.read_metadata(path)
    sizes = []
    for group in map(metadata.row_group, range(metadata.num_row_groups)):
        if group.num_columns != metadata.num_columns:
            # To ask for a column that is not described ends the process.
            raise ValueError(f"a row group has {group.num_columns} columns, the file {metadata.num_columns}")
        columns = [group.column(i) for i in range(group.num_columns)]
        values = sum(column.num_values * _WIDTHS.get(column.physical_type, _WIDEST) for column in columns)
        sizes.append(max(values, group.total_byte_size))
    return sizes


def _text_bytes(path: Path) -> list[int]:
    """Bytes of the texts of each row group that may be a bomb: a long text, stored once, may stand in every row.

    Texts are looked at as they are stored, a dictionary and places in it.
    """
    import pyarrow.parquet as pq

    sizes = []
    with pq.ParquetFile(path) as plain:
        metadata, names = plain.metadata, plain.schema_arrow.names
    for g in range(metadata.num_row_groups):
        group = metadata.row_group(g)
        texts = [group.column(i) for i in range(group.num_columns) if group.column(i).physical_type == "BYTE_ARRAY"]
        most = sum(column.num_values * column.total_uncompressed_size for column in texts)
        if most <= most_unfolded(path):
            continue
        flat = [column.path_in_schema for column in texts if column.path_in_schema in names]
        with pq.ParquetFile(path, read_dictionary=flat) as content:
            table = content.read_row_group(g, columns=flat)
            sizes.append(sum(_texts_of(chunk) for column in table.columns for chunk in column.chunks))
    return sizes


def _texts_of(chunk: Any) -> int:
    """Bytes that a column's texts would take, each for itself."""
    import pyarrow as pa
    import pyarrow.compute as compute

    if not pa.types.is_dictionary(chunk.type):
        return chunk.nbytes
    lengths = compute.call_function("binary_length", [chunk.dictionary]).fill_null(0)
    if not len(lengths):
        return 0
    counts = chunk.indices.drop_null().value_counts()
    used = lengths.take(counts.field("values"))
    return int(sum(a * b for a, b in zip(used.to_pylist(), counts.field("counts").to_pylist(), strict=True)))
