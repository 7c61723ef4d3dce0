"""Row groups of parquet footers: the values that pyarrow reads, and an error for every broken footer."""

import contextlib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.io.parquet_footer import metadata_keys, row_groups, schema
from tests.broken import run_library


def written(path: Path, rows: int = 25) -> Path:
    table = pa.table(
        {
            "name": ["a", None, "ccc", "dd", "e"] * (rows // 5),
            "x": np.arange(float(rows)),
            "single": np.arange(rows, dtype=np.float32),
            "seen": [True, False, None, True, True] * (rows // 5),
            "nested": [{"of": [1, 2], "and": "b"}] * rows,
        }
    )
    pq.write_table(table, path, row_group_size=10)
    return path


def test_row_groups_equal_those_of_pyarrow(tmp_path):
    path = written(tmp_path / "table.parquet")
    metadata, groups = pq.read_metadata(path), row_groups(path)
    assert len(groups) == metadata.num_row_groups == 3
    for g, group in enumerate(groups):
        expected = metadata.row_group(g)
        assert group.uncompressed_bytes == expected.total_byte_size
        assert len(group.columns) == expected.num_columns
        for c, column in enumerate(group.columns):
            other = expected.column(c)
            assert column.path == other.path_in_schema
            assert column.physical_type == other.physical_type
            assert (column.n_values, column.uncompressed_bytes) == (other.num_values, other.total_uncompressed_size)


def test_pyarrow_aborts_on_a_broken_column(tmp_path):
    """One changed byte makes the type of a column unknown."""
    path = written(tmp_path / "table.parquet")
    content = path.read_bytes()
    start = len(content) - 8 - int.from_bytes(content[-8:-4], "little")
    program = "import pyarrow.parquet as pq; pq.read_metadata(path).to_dict()"
    # A column starts with field 1 (the type, an i32), here 6 for BYTE_ARRAY: in Thrift 0x15, zigzag 12.
    column = content.index(b"\x15\x0c\x19", content.index(b"name", start) + 60)
    path.write_bytes(content[: column + 1] + b"\x41" + content[column + 2 :])
    assert run_library(program, path) < 0, "pyarrow raises an error: drop posefuse.io.parquet_footer"
    with pytest.raises(ValueError, match="a column has the unknown type"):
        row_groups(path)


@pytest.fixture(scope="module")
def content(tmp_path_factory) -> bytes:
    return written(tmp_path_factory.mktemp("footer") / "table.parquet").read_bytes()


@given(data=st.data())
def test_broken_footer_is_an_error(data, content, tmp_path_factory):
    broken = bytearray(content)
    length = int.from_bytes(content[-8:-4], "little")
    for _ in range(data.draw(st.integers(1, 4))):
        broken[data.draw(st.integers(len(content) - 8 - length, len(content) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.sampled_from([len(content), 0, 3, len(content) - 1, len(content) // 2]))
    path = tmp_path_factory.getbasetemp() / "broken.parquet"
    path.write_bytes(broken[:cut])
    for read in (schema, metadata_keys):
        with contextlib.suppress(ValueError):
            read(path)
    try:
        groups = row_groups(path)
    except ValueError:
        return
    assert all(column.n_values >= 0 for group in groups for column in group.columns)
