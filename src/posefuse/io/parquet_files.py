"""Parquet files of anybody's, looked at before they are read: a run of one value is as short as its length is long."""

from pathlib import Path
from typing import Any

from posefuse.io.files import most_unfolded, must_unfold
from posefuse.io.parquet_footer import row_groups

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
    sizes = []
    for group in row_groups(path):
        values = sum(column.n_values * _WIDTHS.get(column.physical_type, _WIDEST) for column in group.columns)
        sizes.append(max(values, group.uncompressed_bytes))
    return sizes


def _text_bytes(path: Path) -> list[int]:
    """Bytes of the texts of each row group that may be a bomb: a long text, stored once, may stand in every row.

    Texts are looked at as they are stored, a dictionary and places in it.
    """
    import pyarrow.parquet as pq

    sizes = []
    with pq.ParquetFile(path) as plain:
        names = plain.schema_arrow.names
    for g, group in enumerate(row_groups(path)):
        texts = [column for column in group.columns if column.physical_type == "BYTE_ARRAY"]
        most = sum(column.n_values * column.uncompressed_bytes for column in texts)
        if most <= most_unfolded(path):
            continue
        flat = [column.path for column in texts if column.path in names]
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
