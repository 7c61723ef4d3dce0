"""Row groups of tables that stay in memory."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from posefuse import read_detections
from posefuse.io.keypoints import detection_rows

FRAMES, GROUP = 12, 4
PERSON_BYTES = 17 * 2 * 8


@pytest.fixture
def detections(tmp_path):
    """Return a recording of five tables of three row groups each."""
    for camera in range(5):
        keypoints = [[[[float(100 * camera + f), 1.0]] * 17] for f in range(FRAMES)]
        columns = {"frame": list(range(FRAMES)), "keypoints": keypoints, "scores": [[[0.5] * 17]] * FRAMES}
        pq.write_table(pa.table(columns), tmp_path / f"{camera}.parquet", row_group_size=GROUP)
    return read_detections(tmp_path, "coco_17")


@pytest.mark.parametrize(("kept_groups", "reads"), [(5, 15), (4, 60)])
def test_groups_of_all_tables_are_read_once_if_they_fit(detections, monkeypatch, kept_groups, reads):
    read, original = [], detection_rows._PersonRows._read_group

    def counted(self, content, f, group):
        read.append((f, group))
        return original(self, content, f, group)

    monkeypatch.setattr(detection_rows._PersonRows, "_read_group", counted)
    monkeypatch.setattr(detection_rows, "_MAX_KEPT_BYTES", kept_groups * GROUP * PERSON_BYTES)
    found = [detections.keypoints_px[5 * f : 5 * f + 5][:, 3, 0] for f in range(FRAMES)]
    np.testing.assert_array_equal(found, np.arange(FRAMES)[:, None] + 100.0 * np.arange(5))
    assert len(read) == reads
