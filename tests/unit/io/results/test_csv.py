"""CSV results."""

import csv
import gzip
import io
from dataclasses import replace

import numpy as np
import pandas
import pytest

import posefuse
from posefuse.errors import FileError
from posefuse.io.results import csv as csv_results
from posefuse.io.results.write import write_folder
from posefuse.model.options.options import Options
from posefuse.pipeline.reconstruct import reconstruct
from tests.scenes import body_points, ring, simulate_detections


class TestCsv:
    def rows(self, frame_result, tmp_path) -> list[dict[str, str]]:
        path = tmp_path / "keypoints.csv"
        posefuse.write(frame_result, path, overwrite=True)
        return list(csv.DictReader(io.StringIO(path.read_text())))

    def test_columns_and_stated_precision(self, frame_result, tmp_path):
        rows = self.rows(frame_result, tmp_path)
        assert list(rows[0]) == [
            "frame", "time_s", "person", "keypoint", "x_m", "y_m", "z_m", "sd_x_m", "sd_y_m", "sd_z_m", "n_views",
            "reprojection_error_px", "status", "source",
        ]  # fmt: skip
        layer = frame_result.layers["measured"]
        points = np.array([[float(row[f"{axis}_m"] or "nan") for axis in "xyz"] for row in rows])
        np.testing.assert_allclose(points.reshape(9, 1, 17, 3), layer.points_m, rtol=0.0, atol=5.001e-6)
        deviations = np.array([[float(row[f"sd_{axis}_m"] or "nan") for axis in "xyz"] for row in rows])
        np.testing.assert_allclose(deviations.reshape(9, 1, 17, 3), layer.sd_m, rtol=5.001e-4)
        assert [int(row["n_views"]) for row in rows] == layer.n_views.ravel().tolist()

    def test_points_far_more_certain_than_a_hundredth_of_a_millimeter_have_more_decimals(self, frame_result, tmp_path):
        layer = frame_result.layers["measured"]
        small = replace(layer, points_m=1e-4 * layer.points_m, covariance_m2=1e-8 * layer.covariance_m2)
        csv_results.write([replace(frame_result, layers={"measured": small})], tmp_path / "small.csv", "measured")
        stored = posefuse.read_points(tmp_path / "small.csv")
        assert np.nanmax(np.abs(stored.points_m - small.points_m) / small.sd_m.min(axis=-1, keepdims=True)) <= 0.0101

    def test_long_tables_are_compressed_and_read_by_all(self, frame_result, tmp_path, monkeypatch):
        monkeypatch.setattr(csv_results, "MAX_ROWS", 152)
        (tmp_path / "plain").mkdir()
        files = write_folder(frame_result, tmp_path)[0]
        assert "keypoints.csv.gz" in files
        csv_results.write([frame_result], tmp_path / "plain" / "keypoints.csv", "measured")
        plain = (tmp_path / "plain" / "keypoints.csv").read_bytes()
        packed = tmp_path / "keypoints.csv.gz"
        assert gzip.decompress(packed.read_bytes()) == plain
        assert posefuse.read_points(packed) == posefuse.read_points(tmp_path / "plain" / "keypoints.csv")
        assert pandas.read_csv(packed).equals(pandas.read_csv(tmp_path / "plain" / "keypoints.csv"))
        first = packed.read_bytes()
        csv_results.write([frame_result], packed, "measured")
        assert packed.read_bytes() == first

    def test_a_truncated_or_exploding_compressed_table_is_refused(self, frame_result, tmp_path):
        path = tmp_path / "keypoints.csv.gz"
        posefuse.write(frame_result, path)
        content = path.read_bytes()
        path.write_bytes(content[: len(content) // 2])
        with pytest.raises(FileError, match="truncated"):
            posefuse.read_points(path)
        head = gzip.decompress(content).split(b"\n")[0] + b"\n"
        row = b"0,0,a," + b"k" * 100_000 + b",0,0,0,0,0,0,0,0,ok,measured\n"
        path.write_bytes(gzip.compress(head + row * 3000, 1))
        with pytest.raises(FileError, match="decompression bomb"):
            posefuse.read_points(path)

    def test_points_beyond_any_number_of_decimals_are_written_as_they_are(self, frame_result, tmp_path):
        layer = frame_result.layers["measured"]
        far = replace(layer, points_m=1e20 * layer.points_m)
        csv_results.write([replace(frame_result, layers={"measured": far})], tmp_path / "far.csv", "measured")
        stored = posefuse.read_points(tmp_path / "far.csv").points_m
        np.testing.assert_allclose(stored, far.points_m, rtol=1e-12)

    def test_missing_points_are_empty_with_a_status(self, frame_result, tmp_path):
        row = self.rows(frame_result, tmp_path)[3 * 17 + 5]
        assert row["keypoint"] == "left_shoulder"
        assert (row["x_m"], row["sd_x_m"], row["reprojection_error_px"]) == ("", "", "")
        assert (row["status"], row["source"], row["n_views"]) == ("not_seen", "", "0")
        assert self.rows(frame_result, tmp_path)[2 * 17 + 7]["status"] == "two_views"

    def test_single_camera_result_is_in_pixels(self, rng, tmp_path):
        rig = ring(1)
        flat = reconstruct(rig, simulate_detections(rig, body_points(rng, 2), rng), Options(solve="frame"))
        row = self.rows(flat, tmp_path)[0]
        assert "x_px" in row
        assert "x_m" not in row
