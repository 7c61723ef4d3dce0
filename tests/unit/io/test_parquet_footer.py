"""What a parquet file says of its row groups: as the library says it, and an error whatever is broken."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.io.parquet_footer import row_groups


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


def test_it_is_what_the_library_says(tmp_path):
    path = written(tmp_path / "table.parquet")
    metadata, found = pq.read_metadata(path), row_groups(path)
    assert len(found) == metadata.num_row_groups == 3
    for g, group in enumerate(found):
        theirs = metadata.row_group(g)
        assert group.uncompressed_bytes == theirs.total_byte_size
        assert len(group.columns) == theirs.num_columns
        for c, column in enumerate(group.columns):
            there = theirs.column(c)
            assert column.path == there.path_in_schema
            assert column.physical_type == there.physical_type
            assert (column.n_values, column.uncompressed_bytes) == (there.num_values, there.total_uncompressed_size)


@pytest.fixture(scope="module")
def content(tmp_path_factory) -> bytes:
    return written(tmp_path_factory.mktemp("footer") / "table.parquet").read_bytes()


@given(data=st.data())
def test_a_broken_one_is_an_error(data, content, tmp_path_factory):
    broken = bytearray(content)
    length = int.from_bytes(content[-8:-4], "little")
    for _ in range(data.draw(st.integers(1, 4))):
        broken[data.draw(st.integers(len(content) - 8 - length, len(content) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.sampled_from([len(content), 0, 3, len(content) - 1, len(content) // 2]))
    path = tmp_path_factory.getbasetemp() / "broken.parquet"
    path.write_bytes(broken[:cut])
    try:
        groups = row_groups(path)
    except ValueError:
        return
    assert all(column.n_values >= 0 for group in groups for column in group.columns)
