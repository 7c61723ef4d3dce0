"""Tidy tables of keypoints."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from posefuse import read_detections
from posefuse.errors import DetectionsError, FileError
from posefuse.io.keypoints import tidy
from tests.example_detections import example_detections

HEADER = "camera,frame,time_s,person,track,keypoint,x_px,y_px,confidence"


def tidy_file(path, *rows, header=HEADER):
    file = path / "k.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


class TestTidy:
    def test_hand_written_table(self, tmp_path):
        file = tidy_file(
            tmp_path, "b,7,0.5,0,3,paw,10,20,0.5", "b,7,0.5,0,3,nose,,,", "a,7,0.48,,,,,,", "b,8,0.6,,,,,,"
        )
        detections = read_detections(file)
        assert detections.view_names == ("a", "b")
        assert detections.skeleton.keypoints == ("paw", "nose")
        assert detections.recorded.tolist() == [[True, True], [False, True]]
        assert detections.people_counts.tolist() == [[0, 1], [0, 0]]
        np.testing.assert_array_equal(detections.time_s, [[0.48, 0.5], [np.nan, 0.6]])
        np.testing.assert_array_equal(detections.keypoints_px[:], [[[10, 20], [np.nan, np.nan]]])
        assert detections.track_ids[:].tolist() == [3]
        assert detections.rate_hz == pytest.approx(10.0)

    def test_five_columns_are_enough(self, tmp_path):
        file = tidy_file(tmp_path, "1,0,nose,5,6", "2,0,nose,7,8", header="camera,frame,keypoint,x_px,y_px")
        detections = read_detections(file)
        assert detections.view_names == ("1", "2")
        assert np.isnan(detections.confidence[:]).all()
        assert detections.rate_hz is None

    @pytest.mark.parametrize(
        ("row", "words"),
        [
            ("a,7,0,0,,nose,1,2,1", "row 2: nose of person 0 occurs twice in frame 7 of camera a"),
            ("a,7.5,0,0,,nose,1,2,1", "expected an integer for frame, got 7.5"),
            ("a,,0,0,,nose,1,2,1", "expected an integer for frame, got nothing"),
            ("a,8,0,,,nose,1,2,1", "row 2: a keypoint has no person"),
            ("a,8,0,0,,nose,left,2,1", "the column x_px does not contain numbers"),
            (",8,0,0,,nose,1,2,1", "row 2: the column camera is empty"),
            ("a,8,0,0", "Is the file truncated"),
            ("a,9000000,0,0,,nose,1,2,1", "only 2 frames"),
        ],
    )
    def test_invalid_rows_are_reported_with_their_number(self, tmp_path, row, words):
        with pytest.raises(FileError, match=words):
            read_detections(tidy_file(tmp_path, "a,7,0,0,,nose,1,2,1", row))

    def test_infinity_is_refused(self, tmp_path):
        with pytest.raises(DetectionsError, match="infinite"):
            read_detections(tidy_file(tmp_path, "a,7,0,0,,nose,inf,2,1"))

    def test_parquet_is_read_on_demand(self, tmp_path):
        original = example_detections()
        tidy.write(original, tmp_path / "k.parquet")
        detections = read_detections(tmp_path / "k.parquet")
        assert not isinstance(detections.keypoints_px, np.ndarray)
        np.testing.assert_array_equal(detections.confidence[[3, 0]], np.asarray(original.confidence)[[3, 0]])
        np.testing.assert_array_equal(detections.track_ids[-1], original.track_ids[-1])
        with pytest.raises(IndexError):
            detections.keypoints_px[10_000]

    def test_reordered_rows_are_read(self, tmp_path):
        original = example_detections()
        tidy.write(original, tmp_path / "k.parquet")
        table = pq.read_table(tmp_path / "k.parquet")
        pq.write_table(table.sort_by("x_px"), tmp_path / "sorted.parquet")
        detections = read_detections(tmp_path / "sorted.parquet")
        np.testing.assert_array_equal(detections.keypoints_px[:], original.keypoints_px)
