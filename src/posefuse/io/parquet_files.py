"""Parquet files of anybody's, looked at before they are read: a run of one value is as short as its length is long."""

from pathlib import Path

from posefuse.io.files import must_unfold

_WIDTHS = {"BOOLEAN": 1, "INT32": 4, "FLOAT": 4, "INT96": 12, "BYTE_ARRAY": 16}
_WIDEST = 8


def check_parquet(path: Path) -> None:
    """Look at a file that is read whole.

    Raises:
        FileError: if it is a bomb.
        Exception: what the library raises where it is broken.
    """
    must_unfold(path, sum(_group_bytes(path)))


def check_row_groups(path: Path) -> None:
    """Look at a file that is read a row group at a time.

    Raises:
        FileError: if one of them is a bomb.
        Exception: what the library raises where it is broken.
    """
    must_unfold(path, max(_group_bytes(path), default=0))


def _group_bytes(path: Path) -> list[int]:
    """Bytes of each row group in memory, as far as its description tells."""
    import pyarrow.parquet as pq

    metadata = pq.read_metadata(path)
    sizes = []
    for group in map(metadata.row_group, range(metadata.num_row_groups)):
        columns = [group.column(i) for i in range(group.num_columns)]
        values = sum(column.num_values * _WIDTHS.get(column.physical_type, _WIDEST) for column in columns)
        sizes.append(max(values, group.total_byte_size))
    return sizes
