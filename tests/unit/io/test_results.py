"""Results as files: lossless where promised, honest about what is missing, readable by other programs."""

import csv
import io
import warnings
from dataclasses import replace

import c3d
import ezc3d
import h5py
import numpy as np
import pytest
import xarray

import posefuse
from posefuse.errors import FileError, ResultError
from posefuse.io.netcdf import StoredArray
from posefuse.io.results import netcdf, trc
from posefuse.io.results.axes import y_up_from_world
from posefuse.model.cameras import UP_AXES
from posefuse.model.label_swaps import Swaps
from posefuse.model.options.options import Options
from posefuse.model.options.sync import SyncOptions
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.reconstruct import reconstruct
from tests.scenes import body_points, ring, simulate_detections


@pytest.fixture
def result(rng) -> Reconstruction:
    """Nine frames; one keypoint is missing in frame 3, one has two views, one view lacks a frame."""
    rig = ring(4, "barrel")
    detections = simulate_detections(rig, body_points(rng, 9), rng, rate_hz=60.0)
    keypoints = np.array(detections.keypoints_px)
    keypoints[3 * 4 : 3 * 4 + 4, 5] = np.nan
    keypoints[2 * 4 : 2 * 4 + 2, 7] = np.nan
    options = Options(solve="frame", triangulation=TriangulationOptions(min_views=2))
    return reconstruct(rig, replace(detections, keypoints_px=keypoints), options)


class TestNetcdf:
    def test_comes_back_equal_and_stays_in_the_file(self, result, tmp_path):
        path = tmp_path / "reconstruction.nc"
        posefuse.write(result, path)
        found = posefuse.read_reconstruction(path)
        assert isinstance(found.layers["measured"].points_m, StoredArray)
        assert found == result
        assert found.frames(2, 5) == result.frames(2, 5)

    def test_views_that_were_put_between_their_frames_are_marked(self, result, tmp_path):
        path, (_, second, third, _) = tmp_path / "reconstruction.nc", result.rig.names
        sync = SyncOptions((second, third), (0.0, 0.0), (0.7 / 60.0, 2.05 / 60.0), (0.0, 0.0))
        posefuse.write(replace(result, options=replace(result.options, sync=sync)), path)
        with xarray.open_dataset(path, engine="h5netcdf") as data:
            assert data["retimed"].values.all(axis=0).tolist() == [False, True, False, False]
        assert posefuse.read_reconstruction(path).retimed[4].tolist() == [False, True, False, False]
        assert not result.retimed.any()

    def test_swaps_come_back(self, result, tmp_path):
        state = np.random.default_rng(0).integers(-1, 2, (9, 1, 4, 2)).astype(np.int8)
        told = replace(result, swaps=Swaps(("arm", "leg"), state))
        netcdf.write(told.chunks(4), tmp_path / "told.nc")
        assert posefuse.read_reconstruction(tmp_path / "told.nc") == told
        believed = replace(result, swaps=None)
        posefuse.write(believed, tmp_path / "believed.nc")
        assert posefuse.read_reconstruction(tmp_path / "believed.nc").swaps is None

    @pytest.mark.parametrize("size", [1, 4, 9])
    def test_written_range_by_range_it_is_the_same(self, size, result, tmp_path):
        netcdf.write(result.chunks(size), tmp_path / "parts.nc")
        assert posefuse.read_reconstruction(tmp_path / "parts.nc") == result

    def test_same_bytes(self, result, tmp_path):
        for name in ("a.nc", "b.nc"):
            posefuse.write(result, tmp_path / name)
        assert (tmp_path / "a.nc").read_bytes() == (tmp_path / "b.nc").read_bytes()

    def test_a_result_without_everything(self, result, tmp_path):
        bare = replace(result, tracks=None, noise=None, rate_hz=None, rig=replace(result.rig, up_axis=None))
        posefuse.write(bare, tmp_path / "bare.nc")
        assert posefuse.read_reconstruction(tmp_path / "bare.nc") == bare

    def test_several_layers(self, result, tmp_path):
        both = replace(result, layers={"measured": result.layers["measured"], "solved": result.layers["measured"]})
        posefuse.write(both, tmp_path / "both.nc")
        assert posefuse.read_reconstruction(tmp_path / "both.nc") == both

    def test_xarray_opens_it_with_named_axes(self, result, tmp_path):
        posefuse.write(result, tmp_path / "reconstruction.nc")
        with xarray.open_dataset(tmp_path / "reconstruction.nc") as data:
            position = data["measured_position"]
            assert position.dims == ("time", "individual", "keypoint", "space")
            np.testing.assert_array_equal(position.values, result.layers["measured"].points_m)
            one = position.sel(individual="person_1", keypoint="nose", space="z")
            np.testing.assert_array_equal(one.values, result.layers["measured"].points_m[:, 0, 0, 2])
            np.testing.assert_allclose(data["time"].values, result.time_s)
            status = data["measured_status"]
            assert status.attrs["flag_meanings"].split()[:2] == ["ok", "two_views"]
            assert position.attrs["units"] == "m"

    @pytest.mark.parametrize("keep", [0, 10, 0.5, 0.99])
    def test_cut_short(self, keep, result, tmp_path):
        path = tmp_path / "reconstruction.nc"
        posefuse.write(result, path)
        content = path.read_bytes()
        path.write_bytes(content[: int(keep * len(content)) if keep < 1 else int(keep)])
        with pytest.raises(FileError, match=r"reconstruction\.nc"):
            posefuse.read_reconstruction(path)

    def test_what_is_no_reconstruction(self, tmp_path):
        with pytest.raises(FileError, match="No reconstruction at"):
            posefuse.read_reconstruction(tmp_path / "reconstruction.nc")
        xarray.Dataset({"a": 1}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
        with pytest.raises(FileError, match="not a posefuse reconstruction file"):
            posefuse.read_reconstruction(tmp_path / "other.nc")

    def test_an_attribute_that_is_not_there(self, result, tmp_path):
        posefuse.write(result, tmp_path / "r.nc", "netcdf")
        with h5py.File(tmp_path / "r.nc", "r+") as file:
            del file.attrs["noise_spread"]
        with pytest.raises(FileError, match=r"r.nc lacks the attribute noise_spread: another version"):
            posefuse.read_reconstruction(tmp_path / "r.nc")


class TestCsv:
    def rows(self, result, tmp_path) -> list[dict[str, str]]:
        path = tmp_path / "keypoints.csv"
        posefuse.write(result, path)
        return list(csv.DictReader(io.StringIO(path.read_text())))

    def test_columns_and_every_digit(self, result, tmp_path):
        rows = self.rows(result, tmp_path)
        assert list(rows[0]) == [
            "frame", "time_s", "person", "keypoint", "x_m", "y_m", "z_m", "sd_x_m", "sd_y_m", "sd_z_m", "n_views",
            "reprojection_error_px", "status", "source",
        ]  # fmt: skip
        layer = result.layers["measured"]
        points = np.array([[float(row[f"{axis}_m"] or "nan") for axis in "xyz"] for row in rows])
        np.testing.assert_array_equal(points.reshape(9, 1, 17, 3), layer.points_m)
        deviations = np.array([[float(row[f"sd_{axis}_m"] or "nan") for axis in "xyz"] for row in rows])
        np.testing.assert_array_equal(deviations.reshape(9, 1, 17, 3), layer.sd_m)
        assert [int(row["n_views"]) for row in rows] == layer.n_views.ravel().tolist()

    def test_missing_is_empty_and_says_why(self, result, tmp_path):
        row = self.rows(result, tmp_path)[3 * 17 + 5]
        assert row["keypoint"] == "left_shoulder"
        assert (row["x_m"], row["sd_x_m"], row["reprojection_error_px"]) == ("", "", "")
        assert (row["status"], row["source"], row["n_views"]) == ("not_seen", "", "0")
        assert self.rows(result, tmp_path)[2 * 17 + 7]["status"] == "two_views"

    def test_a_flattened_camera_is_in_pixels(self, rng, tmp_path):
        rig = ring(1)
        flat = reconstruct(rig, simulate_detections(rig, body_points(rng, 2), rng), Options(solve="frame"))
        row = self.rows(flat, tmp_path)[0]
        assert "x_px" in row
        assert "x_m" not in row


class TestTrc:
    def test_an_independent_reading(self, result, tmp_path):
        path = tmp_path / "person.trc"
        posefuse.write(result, path)
        lines = path.read_text().split("\n")
        assert lines[0] == "PathFileType\t4\t(X/Y/Z)\tperson.trc layer=measured"
        header = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
        assert header["DataRate"] == header["CameraRate"] == "60"
        assert (header["NumFrames"], header["NumMarkers"], header["Units"]) == ("9", "17", "m")
        assert lines[3].split("\t")[:6] == ["Frame#", "Time", "nose", "", "", "left_eye"]
        assert lines[4].split("\t")[2:6] == ["X1", "Y1", "Z1", "X2"]
        assert lines[5] == ""
        cells = [line.split("\t") for line in lines[6:] if line]
        assert {len(row) for row in cells} == {2 + 3 * 17}
        assert [row[0] for row in cells] == [str(i) for i in range(1, 10)]
        np.testing.assert_allclose([float(row[1]) for row in cells], np.arange(9) / 60, atol=1e-6)
        assert cells[3][2 + 15 : 2 + 18] == ["", "", ""]
        assert "nan" not in path.read_text()
        # y up: (x, y, z) of the file are (y, z, x) of a z-up world.
        x, y, z = result.layers["measured"].points_m[4, 0, 9]
        np.testing.assert_allclose([float(cell) for cell in cells[4][2 + 27 : 2 + 30]], [y, z, x], atol=1e-6)

    def test_our_reader_agrees(self, result, tmp_path):
        posefuse.write(result, tmp_path / "person.trc")
        found = trc.read(tmp_path / "person.trc")
        assert found.names == result.skeleton.keypoints
        assert found.rate_hz == 60.0
        expected = result.layers["measured"].points_m[:, 0] @ y_up_from_world("z").T
        np.testing.assert_allclose(found.points_m, expected, atol=5e-7)

    def test_without_a_known_up_nothing_turns(self, result, tmp_path):
        unknown = replace(result, rig=replace(result.rig, up_axis=None))
        posefuse.write(unknown, tmp_path / "person.trc")
        np.testing.assert_allclose(
            trc.read(tmp_path / "person.trc").points_m, result.layers["measured"].points_m[:, 0], atol=5e-7
        )

    def test_frames_the_recording_lacks_are_empty_rows(self, result, tmp_path):
        numbers = np.array([4, 5, 6, 9, 10, 11, 12, 13, 14])
        posefuse.write(replace(result, frame_numbers=numbers), tmp_path / "person.trc")
        found = trc.read(tmp_path / "person.trc")
        assert len(found.points_m) == 11
        assert np.isnan(found.points_m[3:5]).all()
        np.testing.assert_allclose(np.diff(found.time_s), 1 / 60, atol=2e-6)

    def test_a_rate_must_be_known_and_even(self, result, tmp_path):
        with pytest.raises(ResultError, match=r"needs a frame rate.*detections.with_rate\(60\)"):
            posefuse.write(replace(result, rate_hz=None, time_s=np.full(9, np.nan)), tmp_path / "person.trc")
        uneven = result.time_s + np.array([0, 0, 0.01, 0, 0, 0, 0, 0, 0])
        with pytest.raises(ResultError, match="evenly spaced"):
            posefuse.write(replace(result, rate_hz=None, time_s=uneven), tmp_path / "person.trc")
        posefuse.write(replace(result, rate_hz=None), tmp_path / "person.trc")
        assert trc.read(tmp_path / "person.trc").rate_hz == pytest.approx(60.0)
        assert sorted(entry.name for entry in tmp_path.iterdir()) == ["person.trc"]

    @pytest.mark.parametrize(
        ("content", "words"),
        [
            ("hello", "not a TRC file"),
            ("PathFileType\n\n\n\n\n", "DataRate and Units"),
            (
                "PathFileType\nDataRate\tUnits\tNumFrames\n60\tm\t3\nFrame#\tTime\ta\n\t\tX1\n1\t0\t1\t2\t3\n",
                "has 1 rows, but its header says 3 frames. Is it truncated",
            ),
            ("PathFileType\nDataRate\tUnits\n60\tm\nFrame#\tTime\ta\n\t\tX1\n1\t0\t1\tx\t3\n", "line 6.*neither"),
        ],
    )
    def test_broken_files(self, content, words, tmp_path):
        (tmp_path / "a.trc").write_text(content)
        with pytest.raises(FileError, match=words):
            trc.read(tmp_path / "a.trc")


def by_c3d(path):
    """Shape (frame, point, 5): x, y, z, residual, and how many cameras, as an independent reader has them."""
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.stack([points for _, points, _ in c3d.Reader(file).read_frames()])


class TestC3d:
    def test_ezc3d_reads_it(self, result, tmp_path):
        posefuse.write(result, tmp_path / "person.c3d")
        found = ezc3d.c3d(str(tmp_path / "person.c3d"))
        point = found["parameters"]["POINT"]
        assert point["UNITS"]["value"] == ["mm"]
        assert point["RATE"]["value"][0] == 60.0
        assert tuple(point["LABELS"]["value"]) == result.skeleton.keypoints
        assert (point["X_SCREEN"]["value"], point["Y_SCREEN"]["value"]) == (["+X"], ["+Z"])
        assert found["parameters"]["POSEFUSE"]["LAYER"]["value"] == ["measured"]
        assert found["parameters"]["POSEFUSE"]["VIEWS"]["value"] == list(result.rig.names)
        layer = result.layers["measured"]
        expected = 1000.0 * np.moveaxis(layer.points_m[:, 0], 0, -1).transpose(1, 0, 2)
        np.testing.assert_allclose(found["data"]["points"][:3], expected, atol=1e-3)
        missing = np.isnan(found["data"]["points"][0])
        assert missing[5, 3]
        assert missing.sum() == 1

    def test_an_independent_reader_agrees(self, result, tmp_path):
        posefuse.write(result, tmp_path / "person.c3d")
        layer = result.layers["measured"]
        frames = by_c3d(tmp_path / "person.c3d")
        assert frames.shape[0] == 9
        np.testing.assert_allclose(frames[4, 9, :3], 1000 * layer.points_m[4, 0, 9], atol=1e-3)
        residuals, cameras = frames[..., 3], frames[..., 4]
        assert residuals[3, 5] == -1
        assert (residuals >= 0).sum() == residuals.size - 1
        known = 1000.0 * np.sqrt((layer.sd_m[:, 0] ** 2).mean(axis=-1))
        np.testing.assert_allclose(residuals[known > 0], known[known > 0], atol=0.052)
        assert (cameras[2, 7], cameras[0, 0]) == (0b1100, 0b1111)

    def test_points_that_are_known_badly_are_not_missing(self, result, tmp_path):
        """A residual of more than 127 steps beside the sign of the word is one all the same."""
        layer = result.layers["measured"]
        rough = replace(layer, covariance_m2=np.asarray(layer.covariance_m2) * 0.0 + [4e-4, 0, 0, 4e-4, 0, 4e-4])
        posefuse.write(replace(result, layers={"measured": rough}), tmp_path / "person.c3d")
        residuals = by_c3d(tmp_path / "person.c3d")[..., 3]
        assert (residuals < 0).sum() == 1
        np.testing.assert_allclose(residuals[residuals >= 0], 20.0, atol=0.051)

    def test_more_views_than_bits(self, rng, tmp_path):
        rig = ring(9)
        many = reconstruct(rig, simulate_detections(rig, body_points(rng, 3), rng), Options(solve="frame"))
        posefuse.write(many, tmp_path / "person.c3d")
        assert not by_c3d(tmp_path / "person.c3d")[..., 4].any()
        found = ezc3d.c3d(str(tmp_path / "person.c3d"))
        np.testing.assert_allclose(found["parameters"]["POSEFUSE"]["MEAN_VIEWS"]["value"], 9.0)

    def test_many_keypoints(self, rng, tmp_path):
        rig = ring(3)
        many = reconstruct(rig, simulate_detections(rig, body_points(rng, 3, 300), rng), Options(solve="frame"))
        posefuse.write(many, tmp_path / "person.c3d")
        assert ezc3d.c3d(str(tmp_path / "person.c3d"))["data"]["points"].shape == (4, 300, 3)

    def test_long_recordings_use_the_standards_extension(self, result, tmp_path):
        n = 70_000
        first = result.frames(0, 1)
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

    def test_pixels_are_no_place(self, rng, tmp_path):
        rig = ring(1)
        flat = reconstruct(rig, simulate_detections(rig, body_points(rng, 2), rng), Options(solve="frame"))
        with pytest.raises(ResultError, match="in px.*Use TRC"):
            posefuse.write(flat, tmp_path / "person.c3d")
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("up", UP_AXES)
def test_turning_puts_up_along_y(up):
    turn = y_up_from_world(up)
    axis = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}[up[-1]]
    np.testing.assert_allclose(turn @ (np.array(axis) * (-1 if up[0] == "-" else 1)), [0, 1, 0])
    np.testing.assert_allclose(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_unknown_formats(result, tmp_path):
    with pytest.raises(ResultError, match="No format 'bvhh'"):
        posefuse.write(result, tmp_path / "a.nc", "bvhh")
    with pytest.raises(ResultError, match="ends in no known format. Formats: netcdf, parquet, anipose"):
        posefuse.write(result, tmp_path / "a.xyz")
    posefuse.write(result, tmp_path / "a.xyz", "trc")
    assert trc.read(tmp_path / "a.xyz").rate_hz == 60
