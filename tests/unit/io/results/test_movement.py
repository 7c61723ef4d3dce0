"""Results in the format of movement."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import xarray

import posefuse
from posefuse.errors import FileError
from tests.unit.io.results.test_registry import solved


class TestMovement:
    @pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
    def test_xarray_and_the_validator_of_movement_accept_the_file(self, engine, layered_result, tmp_path):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from movement.validators.datasets import ValidPosesInputs

        posefuse.write(layered_result, tmp_path / "movement.nc")
        with xarray.open_dataset(tmp_path / "movement.nc", engine=engine) as data:
            assert data["position"].dims == ("time", "space", "keypoint", "individual")
            one = data["position"].sel(individual="person_1", keypoint="nose")
            np.testing.assert_array_equal(one.values, solved(layered_result)[:, 0, 0])
            assert (data.attrs["ds_type"], data.attrs["time_unit"], data.attrs["fps"]) == ("poses", "seconds", 60.0)
            np.testing.assert_allclose(data["time"].values, layered_result.time_s)
            singular = "keypoint" in ValidPosesInputs.DIM_NAMES
            ValidPosesInputs.validate(data if singular else data.rename(keypoint="keypoints", individual="individuals"))

    def test_movement_loads_the_anipose_file(self, layered_result, tmp_path):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from movement.io import load_poses

            posefuse.write(layered_result, tmp_path / "anipose.csv")
            data = load_poses.from_anipose_file(tmp_path / "anipose.csv", fps=60.0)
        axis = "keypoint" if "keypoint" in data.dims else "keypoints"
        for k, name in enumerate(layered_result.skeleton.keypoints):
            actual = data["position"].sel({axis: name}).squeeze().values
            np.testing.assert_array_equal(actual, solved(layered_result)[:, 0, k])

    def test_file_of_an_older_version_is_read(self, tmp_path):
        points = np.random.default_rng(0).normal(size=(4, 3, 2, 1))
        axes = ("time", "space", "keypoints", "individuals")
        names = {"time": np.arange(4) / 30, "space": list("xyz"), "keypoints": ["a", "b"], "individuals": ["id_0"]}
        data = xarray.Dataset(
            {"position": (axes, points)}, names, {"ds_type": "poses", "time_unit": "seconds", "fps": 30.0}
        )
        data.to_netcdf(tmp_path / "x.nc", engine="h5netcdf")
        actual = posefuse.read_points(tmp_path / "x.nc")
        assert (actual.keypoints, actual.person_ids, actual.rate_hz, actual.status) == (
            ("a", "b"),
            ("id_0",),
            30.0,
            None,
        )
        np.testing.assert_array_equal(actual.points_m[:, 0], points[..., 0].transpose(0, 2, 1))

    def test_unknown_times(self, pair_result, tmp_path):
        unknown = replace(pair_result, time_s=np.full(6, np.nan), rate_hz=None)
        posefuse.write(unknown, tmp_path / "movement.nc")
        points = posefuse.read_points(tmp_path / "movement.nc")
        assert (points.rate_hz, np.isnan(points.time_s).all()) == (None, True)
        np.testing.assert_array_equal(points.frame_numbers, pair_result.frame_numbers)


def test_cyclic_heap_is_refused(pair_result, tmp_path):
    posefuse.write(pair_result, tmp_path / "movement.nc")
    content = bytearray((tmp_path / "movement.nc").read_bytes())
    at = start = content.index(b"GCOL")
    at += 16
    while content[at : at + 2] != b"\0\0":
        at += 16 + -(-int.from_bytes(content[at + 8 : at + 16], "little") // 8) * 8
    content[at + 8 : at + 16] = (8).to_bytes(8, "little")
    (tmp_path / "movement.nc").write_bytes(content)
    with pytest.raises(FileError, match=f"its strings at byte {start} are corrupt"):
        posefuse.read_points(tmp_path / "movement.nc", "movement")
