"""CSV results."""

import csv
import io

import numpy as np

import posefuse
from posefuse.model.options.options import Options
from posefuse.pipeline.reconstruct import reconstruct
from tests.scenes import body_points, ring, simulate_detections


class TestCsv:
    def rows(self, frame_result, tmp_path) -> list[dict[str, str]]:
        path = tmp_path / "keypoints.csv"
        posefuse.write(frame_result, path, overwrite=True)
        return list(csv.DictReader(io.StringIO(path.read_text())))

    def test_columns_and_full_precision(self, frame_result, tmp_path):
        rows = self.rows(frame_result, tmp_path)
        assert list(rows[0]) == [
            "frame", "time_s", "person", "keypoint", "x_m", "y_m", "z_m", "sd_x_m", "sd_y_m", "sd_z_m", "n_views",
            "reprojection_error_px", "status", "source",
        ]  # fmt: skip
        layer = frame_result.layers["measured"]
        points = np.array([[float(row[f"{axis}_m"] or "nan") for axis in "xyz"] for row in rows])
        np.testing.assert_array_equal(points.reshape(9, 1, 17, 3), layer.points_m)
        deviations = np.array([[float(row[f"sd_{axis}_m"] or "nan") for axis in "xyz"] for row in rows])
        np.testing.assert_array_equal(deviations.reshape(9, 1, 17, 3), layer.sd_m)
        assert [int(row["n_views"]) for row in rows] == layer.n_views.ravel().tolist()

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
