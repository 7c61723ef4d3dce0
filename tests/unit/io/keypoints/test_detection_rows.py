"""Row groups of tables that stay in memory."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from posefuse import read_detections
from posefuse.errors import FileError
from posefuse.io.keypoints import detection_rows

FRAMES, GROUP = 12, 4
PERSON_BYTES = 17 * 2 * 8


def recording(folder, tables):
    """Return a recording of tables of three row groups each."""
    for camera in range(tables):
        keypoints = [[[[float(100 * camera + f), 1.0]] * 17] for f in range(FRAMES)]
        columns = {"frame": list(range(FRAMES)), "keypoints": keypoints, "scores": [[[0.5] * 17]] * FRAMES}
        pq.write_table(pa.table(columns), folder / f"{camera}.parquet", row_group_size=GROUP)
    return read_detections(folder, "coco_17")


@pytest.mark.parametrize(("tables", "max_groups", "max_kept", "reads"), [
    (5, 5, 9, 15), (5, 4, 9, 60), (5, 9, 4, 60), (3, 1, 9, 9), (3, 0, 9, 36),
])  # fmt: skip
def test_groups_of_all_tables_are_read_once_if_they_fit(tmp_path, monkeypatch, tables, max_groups, max_kept, reads):
    """Three groups are kept however large they are together, unless one alone exceeds the limit."""
    detections = recording(tmp_path, tables)
    read, original = [], detection_rows._PersonRows._read_group

    def counted(self, content, f, group):
        read.append((f, group))
        return original(self, content, f, group)

    monkeypatch.setattr(detection_rows._PersonRows, "_read_group", counted)
    monkeypatch.setattr(detection_rows, "_MAX_KEPT_BYTES", max_groups * GROUP * PERSON_BYTES)
    monkeypatch.setattr(detection_rows, "_MAX_KEPT", max_kept)
    found = [detections.keypoints_px[tables * f : tables * f + tables][:, 3, 0] for f in range(FRAMES)]
    np.testing.assert_array_equal(found, np.arange(FRAMES)[:, None] + 100.0 * np.arange(tables))
    assert len(read) == reads


@pytest.mark.parametrize(("numbers", "got"), [(["a"] * FRAMES, "'a'"), ([*range(FRAMES - 1), None], "nan")])
def test_frame_numbers_that_are_no_integers_are_named(tmp_path, numbers, got):
    recording(tmp_path, 2)
    file = tmp_path / "1.parquet"
    table = pq.read_table(file)
    pq.write_table(table.set_column(0, "frame", pa.array(numbers)), file)
    with pytest.raises(FileError, match=rf"1\.parquet: expected an integer for the frame number, got {got}\."):
        read_detections(tmp_path, "coco_17")
