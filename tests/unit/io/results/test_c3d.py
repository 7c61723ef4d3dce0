"""C3D files."""

import warnings
from dataclasses import replace

import c3d
import ezc3d
import numpy as np
import pytest

import posefuse
from posefuse.errors import ResultError
from posefuse.model.options.options import Options
from posefuse.pipeline.reconstruct import reconstruct
from tests.scenes import body_points, ring, simulate_detections


def by_c3d(path):
    """Shape (frame, point, 5): x, y, z, residual, and how many cameras, as an independent reader has them."""
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.stack([points for _, points, _ in c3d.Reader(file).read_frames()])


class TestC3d:
    def test_ezc3d_reads_the_file(self, frame_result, tmp_path):
        posefuse.write(frame_result, tmp_path / "person.c3d")
        actual = ezc3d.c3d(str(tmp_path / "person.c3d"))
        point = actual["parameters"]["POINT"]
        assert point["UNITS"]["value"] == ["mm"]
        assert point["RATE"]["value"][0] == 60.0
        assert tuple(point["LABELS"]["value"]) == frame_result.skeleton.keypoints
        assert (point["X_SCREEN"]["value"], point["Y_SCREEN"]["value"]) == (["+X"], ["+Z"])
        assert actual["parameters"]["POSEFUSE"]["LAYER"]["value"] == ["measured"]
        assert actual["parameters"]["POSEFUSE"]["VIEWS"]["value"] == list(frame_result.rig.names)
        layer = frame_result.layers["measured"]
        expected = 1000.0 * np.moveaxis(layer.points_m[:, 0], 0, -1).transpose(1, 0, 2)
        np.testing.assert_allclose(actual["data"]["points"][:3], expected, atol=1e-3)
        missing = np.isnan(actual["data"]["points"][0])
        assert missing[5, 3]
        assert missing.sum() == 1

    def test_independent_reader_agrees(self, frame_result, tmp_path):
        posefuse.write(frame_result, tmp_path / "person.c3d")
        layer = frame_result.layers["measured"]
        frames = by_c3d(tmp_path / "person.c3d")
        assert frames.shape[0] == 9
        np.testing.assert_allclose(frames[4, 9, :3], 1000 * layer.points_m[4, 0, 9], atol=1e-3)
        residuals, cameras = frames[..., 3], frames[..., 4]
        assert residuals[3, 5] == -1
        assert (residuals >= 0).sum() == residuals.size - 1
        reference = 1000.0 * np.sqrt((layer.sd_m[:, 0] ** 2).mean(axis=-1))
        np.testing.assert_allclose(residuals[reference > 0], reference[reference > 0], atol=0.052)
        assert (cameras[2, 7], cameras[0, 0]) == (0b1100, 0b1111)

    def test_uncertain_points_are_not_missing(self, frame_result, tmp_path):
        """A residual of more than 127 steps beside the sign of the word is one all the same."""
        layer = frame_result.layers["measured"]
        rough = replace(layer, covariance_m2=np.asarray(layer.covariance_m2) * 0.0 + [4e-4, 0, 0, 4e-4, 0, 4e-4])
        posefuse.write(replace(frame_result, layers={"measured": rough}), tmp_path / "person.c3d")
        residuals = by_c3d(tmp_path / "person.c3d")[..., 3]
        assert (residuals < 0).sum() == 1
        np.testing.assert_allclose(residuals[residuals >= 0], 20.0, atol=0.051)

    def test_more_views_than_bits_of_the_camera_mask(self, rng, tmp_path):
        rig = ring(9)
        many = reconstruct(rig, simulate_detections(rig, body_points(rng, 3), rng), Options(solve="frame"))
        posefuse.write(many, tmp_path / "person.c3d")
        assert not by_c3d(tmp_path / "person.c3d")[..., 4].any()
        actual = ezc3d.c3d(str(tmp_path / "person.c3d"))
        np.testing.assert_allclose(actual["parameters"]["POSEFUSE"]["MEAN_VIEWS"]["value"], 9.0)

    def test_many_keypoints(self, rng, tmp_path):
        rig = ring(3)
        many = reconstruct(rig, simulate_detections(rig, body_points(rng, 3, 300), rng), Options(solve="frame"))
        posefuse.write(many, tmp_path / "person.c3d")
        assert ezc3d.c3d(str(tmp_path / "person.c3d"))["data"]["points"].shape == (4, 300, 3)

    def test_long_recordings_use_the_standards_extension(self, frame_result, tmp_path):
        n = 70_000
        first = frame_result.frames(0, 1)
        layer = first.layers["measured"]
        repeated = type(layer)(*(np.repeat(np.asarray(value), n, axis=0) for value in vars(layer).values()))
        long = replace(
            first, frame_numbers=np.arange(n), time_s=np.arange(n) / 60, layers={"measured": repeated}, tracks=None
        )
        posefuse.write(long, tmp_path / "person.c3d")
        with (tmp_path / "person.c3d").open("rb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reader = c3d.Reader(file)
            assert (reader.first_frame, reader.last_frame) == (1, n)
            *_, last = reader.read_frames()
        assert last[0] == n
        np.testing.assert_allclose(last[1][2, :3], 1000 * layer.points_m[0, 0, 2], atol=1e-3)

    def test_pixel_results_are_refused(self, rng, tmp_path):
        rig = ring(1)
        flat = reconstruct(rig, simulate_detections(rig, body_points(rng, 2), rng), Options(solve="frame"))
        with pytest.raises(ResultError, match="in px.*Use TRC"):
            posefuse.write(flat, tmp_path / "person.c3d")
        assert list(tmp_path.iterdir()) == []
