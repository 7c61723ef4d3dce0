"""Tables of detections."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from posefuse import read_detections
from posefuse.errors import FileError
from posefuse.io.keypoints import detection_tables, openpose
from tests.example_detections import example_detections


class TestDetectionTables:
    def table(self, path, frames, people, **more):
        shape = [[[[float(f), 2.0]] * 17 for _ in range(n)] for f, n in zip(frames, people, strict=True)]
        scores = [[[0.5] * 17 for _ in range(n)] for n in people]
        pq.write_table(pa.table({"frame": frames, "keypoints": shape, "scores": scores} | more), path)

    def test_tables_of_other_programs_with_frames_in_any_order(self, tmp_path):
        self.table(tmp_path / "a.parquet", [3, 1], [2, 0], timestamp_ns=[2_000_000_000, 1_000_000_000])
        self.table(tmp_path / "b.parquet", [1, 2], [1, 1], timestamp_ns=[1_100_000_000, 1_600_000_000])
        detections = read_detections(tmp_path, "coco_17")
        assert detections.people_counts.tolist() == [[0, 1], [0, 1], [2, 0]]
        assert detections.recorded.tolist() == [[True, True], [False, True], [True, False]]
        np.testing.assert_allclose(detections.time_s, [[1.0, 1.1], [np.nan, 1.6], [2.0, np.nan]])
        assert detections.keypoints_px[:][:, 0, 0].tolist() == [1.0, 2.0, 3.0, 3.0]

    def test_one_table_of_all_cameras(self, tmp_path):
        self.table(tmp_path / "all.parquet", [1, 1, 2], [1, 2, 1], camera=["b", "a", "b"])
        detections = read_detections(tmp_path / "all.parquet", "coco_17")
        assert detections.people_counts[:, detections.view_names.index("a")].tolist() == [2, 0]

    def test_folders_of_parts(self, tmp_path):
        for camera in "ab":
            (tmp_path / camera).mkdir()
            self.table(tmp_path / camera / "x.parquet", [3], [2])
        self.table(tmp_path / "a" / "0.parquet", [0, 1], [1, 1])
        self.table(tmp_path / "a" / "1.parquet", [2], [1])
        assert read_detections(tmp_path, "coco_17").people_counts.tolist() == [[1, 0], [1, 0], [1, 0], [2, 2]]

    def test_frame_twice_is_an_error(self, tmp_path):
        self.table(tmp_path / "a.parquet", [1, 1], [1, 1])
        with pytest.raises(FileError, match="'a' has two rows for frame 1"):
            read_detections(tmp_path, "coco_17")

    def test_names_do_not_leave_the_folder(self, tmp_path):
        detections = example_detections()
        hostile = detections.views(["left"])
        object.__setattr__(hostile, "view_names", ("../outside",))
        for write in (detection_tables.write, openpose.write):
            with pytest.raises(FileError, match="is not a valid file name"):
                write(hostile, tmp_path / "out")
        assert list(tmp_path.iterdir()) == []
