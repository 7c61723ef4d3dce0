"""FreeMoCap results."""

import zipfile
from dataclasses import replace

import numpy as np
import pandas
import pytest

import posefuse
from posefuse.errors import FileError, ResultError
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.reconstruct import reconstruct
from tests.properties.test_result_files import some_result
from tests.scenes import body_points, ring, simulate_detections
from tests.unit.io.results.test_registry import solved


class TestFreeMoCap:
    def test_names_and_shapes(self, tmp_path):
        skeleton = posefuse.find_skeleton("mediapipe_holistic_553")
        original = _holistic(skeleton)
        posefuse.write(original, tmp_path / "recording", "freemocap")
        folder = tmp_path / "recording" / "output_data"
        data = "mediapipe_3dData_{}numFrames_numTrackedPoints_{}.npy"
        shapes = {
            f"raw_data/{data.format('', 'spatialXYZ')}": (3, 553, 3),
            f"raw_data/{data.format('', 'reprojectionError')}": (3, 553),
            f"raw_data/{data.format('numCams_', 'reprojectionError')}": (2, 3, 553),
            "mediapipe_skeleton_3d.npy": (3, 553, 3),
            "mediapipe_body_3d_xyz.npy": (3, 33, 3),
            "mediapipe_right_hand_3d_xyz.npy": (3, 21, 3),
            "mediapipe_left_hand_3d_xyz.npy": (3, 21, 3),
            "mediapipe_face_3d_xyz.npy": (3, 478, 3),
        }
        arrays = {name: np.load(folder / name) for name in shapes}
        assert {name: array.shape for name, array in arrays.items()} == shapes
        points = 1000.0 * np.asarray(original.layers["measured"].points_m)[:, 0]
        np.testing.assert_allclose(arrays["mediapipe_skeleton_3d.npy"], points, rtol=1e-15)
        cut = [arrays[f"mediapipe_{part}_3d_xyz.npy"] for part in ("body", "right_hand", "left_hand", "face")]
        np.testing.assert_array_equal(np.concatenate(cut, axis=1), arrays["mediapipe_skeleton_3d.npy"])
        table = pandas.read_csv(folder / "mediapipe_left_hand_3d_xyz.csv")
        assert list(table.columns[:4]) == [
            "left_hand_0000_x",
            "left_hand_0000_y",
            "left_hand_0000_z",
            "left_hand_0001_x",
        ]
        np.testing.assert_array_equal(table.to_numpy(), cut[2].reshape(3, -1))

    def test_raw_array_is_the_measured_layer(self, layered_result, tmp_path):
        posefuse.write(layered_result, tmp_path / "a.npz")
        with np.load(tmp_path / "a.npz") as arrays:
            raw = arrays["coco_17_3dData_numFrames_numTrackedPoints_spatialXYZ"]
            np.testing.assert_array_equal(raw, 1000.0 * np.asarray(layered_result.layers["measured"].points_m)[:, 0])
            np.testing.assert_array_equal(arrays["coco_17_skeleton_3d"], 1000.0 * solved(layered_result)[:, 0])

    def test_freemocap_recording_is_not_overwritten(self, layered_result, tmp_path):
        second = tmp_path / "recording" / "output_data" / "mediapipe_skeleton_3d.npy"
        second.parent.mkdir(parents=True)
        second.write_bytes(b"theirs")
        with pytest.raises(FileError, match="already contains other files"):
            posefuse.write(layered_result, tmp_path / "recording", "freemocap", overwrite=True)
        assert second.read_bytes() == b"theirs"

    def test_single_camera_result_is_refused(self, tmp_path):
        rng = np.random.default_rng(0)
        rig = ring(1)
        flat = reconstruct(rig, simulate_detections(rig, body_points(rng, 2), rng), Options(solve="frame"))
        for form in ("npz", "freemocap", "anipose"):
            with pytest.raises(ResultError, match=f"{form} needs 3D points"):
                posefuse.write(flat, tmp_path / form, form)
        for name in ("a.parquet", "points3d.h5", "movement.nc"):
            posefuse.write(flat, tmp_path / name)
            assert posefuse.read_points(tmp_path / name).unit == "px"

    def test_decompression_bomb_is_refused(self, tmp_path, monkeypatch):
        monkeypatch.setattr("posefuse.io.files._LARGE_BYTES", 2**20)
        with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("head.npy", bytes(2**22))
        with pytest.raises(FileError, match="would expand to"):
            posefuse.read_points(tmp_path / "a.npz")


def _holistic(skeleton: posefuse.Skeleton) -> Reconstruction:
    rng = np.random.default_rng(2)
    small = some_result(2, ["me"], ["a", "b", "c", "d"], ["x", "y"], 3)
    layer = small.layers["measured"]
    big = {
        name: np.repeat(np.asarray(getattr(layer, name)), 139, axis=2)[:, :, : len(skeleton)]
        for name in ("covariance_m2", "status", "source", "reprojection_error_px", "view_status", "view_error_px")
    }
    points = rng.normal(size=(3, 1, len(skeleton), 3))
    layer = posefuse.Layer(points_m=points, **big)
    return replace(small, skeleton=skeleton, frame_numbers=np.arange(3), layers={"measured": layer})
