"""Projections of a result as OpenPose JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError, ResultError
from posefuse.io.recording import find_recording
from posefuse.io.results import openpose
from posefuse.model.cameras import CameraRig
from tests.figures import model_layer, posed


class TestOpenPose:
    def test_projections_are_read_back(self, tmp_path):
        result = posed("coco_17", 6, people=2, away=(slice(2, 3),))
        openpose.write(result, tmp_path / "o", "model")
        detections = posefuse.read_detections(tmp_path / "o", "coco_17")
        assert detections.view_names == tuple(f"{name}_json" for name in result.rig.names)
        np.testing.assert_array_equal(detections.frame_numbers, result.frame_numbers)
        points = np.asarray(result.layers["model"].points_m)
        for f in range(6):
            for v, camera in enumerate(result.rig.cameras):
                row = f * 3 + v
                observed = np.asarray(detections.keypoints_px[detections.offsets[row] : detections.offsets[row + 1]])
                expected, _ = camera.project(points[f])
                size = np.array(camera.size_px)
                outside = ~((expected >= -0.5) & (expected <= size - 0.5)).all(axis=-1)
                expected[outside] = np.nan
                expected = expected[np.isfinite(expected).any(axis=(1, 2))]
                np.testing.assert_allclose(observed, expected, atol=5.1e-4)

    def test_points_outside_the_image_are_missing(self, tmp_path):
        result = posed("coco_17", 1)
        points = np.array(result.layers["model"].points_m)
        points[0, 0, 3] += 100.0
        openpose.write(replace(result, layers={"model": model_layer(points)}), tmp_path / "o", "model")
        content = json.loads((tmp_path / "o" / "cam_0_json" / "cam_0_000000000100_keypoints.json").read_text())
        (person,) = content["people"]
        assert person["pose_keypoints_2d"][9:12] == [0.0, 0.0, 0.0]
        assert person["pose_keypoints_2d"][2] == 1.0
        assert person["posefuse"]["status"][0] == "ok"
        assert person["posefuse"]["source"] == ["modeled"] * 17

    @pytest.mark.parametrize("name", ["../../etc", "a/b", "..", ".hidden"])
    def test_camera_names_do_not_leave_the_folder(self, name, tmp_path):
        result = posed("coco_17", 1)
        cameras = (replace(result.rig.cameras[0], name=name), *result.rig.cameras[1:])
        with pytest.raises(FileError, match="is not a valid file name"):
            openpose.write(replace(result, rig=CameraRig(cameras, up_axis="z")), tmp_path / "o", "model")
        assert list(tmp_path.iterdir()) == []

    def test_single_camera_result_is_not_projected(self, tmp_path):
        with pytest.raises(ResultError, match="openpose needs 3D points"):
            openpose.write(replace(posed("coco_17", 1), unit="px"), tmp_path / "o", "model")

    def test_written_projections_are_not_found_as_keypoints_of_a_recording(self, tmp_path):
        result = posed("coco_17", 3)
        openpose.write(result, tmp_path / "pose", "model")
        openpose.write(result, tmp_path / "out" / "openpose", "model")
        posefuse.write(result, tmp_path / "out" / "reconstruction.nc")
        assert [actual.path for actual in find_recording(tmp_path).keypoints] == [tmp_path / "pose"]
