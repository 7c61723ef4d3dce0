"""Results for other programs: what these read is what was meant, and what is said of broken files and wrong wishes."""

import json
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pandas
import pyarrow.parquet
import pytest
import xarray

import posefuse
from posefuse.errors import FileError, PosefuseError, ResultError
from posefuse.io.results.registry import RESULTS
from posefuse.io.results.write import additional_names, write_folder
from posefuse.model.alignment import Alignment
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import is_used
from posefuse.pipeline.reconstruct import reconstruct
from tests.broken import broken
from tests.laws.test_result_files import FILES, some_result
from tests.scenes import body_points, ring, simulate_detections


@pytest.fixture(scope="module")
def result() -> Reconstruction:
    """Nine frames of one person, a keypoint missing in frame 3; measured, and a second layer a centimeter off."""
    rng = np.random.default_rng(1)
    rig = ring(4, "barrel")
    detections = simulate_detections(rig, body_points(rng, 9), rng, rate_hz=60.0)
    keypoints = np.array(detections.keypoints_px)
    keypoints[3 * 4 : 3 * 4 + 4, 5] = np.nan
    found = reconstruct(rig, replace(detections, keypoints_px=keypoints), Options(solve="frame"))
    measured = found.layers["measured"]
    solved = replace(measured, points_m=np.asarray(measured.points_m) + 0.01)
    return replace(found, layers={"measured": measured, "solved": solved})


@pytest.fixture(scope="module")
def people() -> Reconstruction:
    """Two people, numbers of any kind."""
    return some_result(3, ["anna", "ben"], ["nose", "tail", "left_paw", "right_paw"], ["a", "b"], 6)


def solved(result: Reconstruction) -> np.ndarray:
    return np.asarray(result.layers["solved"].points_m)


def test_formats_are_told_by_names(result, tmp_path):
    names = {
        "a.parquet": "parquet", "pose_anipose.csv": "anipose", "x_DLC_3d.csv": "deeplabcut", "DLC_3d.h5": "deeplabcut",
        "points3d.h5": "sleap", "a.movement.nc": "movement", "a.npz": "npz", "a.csv": "csv",
    }  # fmt: skip
    lacks = {
        "pose_anipose.csv": "times, status, covariances, which views",
        "x_DLC_3d.csv": "times, status, errors, covariances, views in CSV",
        "a.csv": "covariances between the axes, and which views",
    }
    for name, form in names.items():
        done = posefuse.write(result, tmp_path / name)
        assert done.files == (tmp_path / name,)
        assert done.layer == "solved"
        assert (
            done.notes[0] == f"{form}: the layer solved; without measured, detections of each track, left/right swaps."
        )
        assert done.notes[1:] == ((f"{form} cannot hold {lacks[name]}.",) if name in lacks else ())
        np.testing.assert_allclose(posefuse.read_points(tmp_path / name).points_m, solved(result), rtol=1e-15)
    with pytest.raises(ResultError, match=r"x.h5 may be in the format deeplabcut or sleap"):
        posefuse.write(result, tmp_path / "x.h5")
    with pytest.raises(ResultError, match=r"No format 'parket'. Did you mean 'parquet'"):
        posefuse.write(result, tmp_path / "x", "parket")
    assert posefuse.write(result, tmp_path / "reconstruction.nc").notes == ()


@pytest.mark.parametrize("kind", [kind for kind in FILES if kind != "nwb"])
def test_the_same_result_gives_the_same_bytes(kind, people, tmp_path):
    form, name = FILES[kind]
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        posefuse.write(people, tmp_path / folder / name, form)
    files = sorted(file.relative_to(tmp_path / "one") for file in (tmp_path / "one").rglob("*") if file.is_file())
    assert files
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes(), file


def test_points_are_tried_in_a_fixed_order_of_formats():
    order = ["parquet", "anipose", "deeplabcut", "csv", "npz", "freemocap", "movement", "sleap", "nwb", "trc", "c3d"]
    assert [form.name for form in RESULTS if form.read] == order
    assert [form.name for form in RESULTS if form.reads and not form.read] == ["netcdf"]


def test_every_written_format_has_exactly_one_writer():
    for form in RESULTS.written():
        writers = (form.write_layer, form.write_person, form.write_figure, form.write_result)
        assert sum(writer is not None for writer in writers) == 1, form.name
    assert set(additional_names()) <= {form.name for form in RESULTS.written()}


def test_nobody_and_no_frames(people, tmp_path):
    empty = people.frames(0, 0)
    for kind in ("anipose", "sleap", "h5", "npz"):
        form, name = FILES[kind]
        with pytest.raises(ResultError, match="no frames"):
            posefuse.write(empty, tmp_path / name, form)
    sparse = replace(people, frame_numbers=np.array([0, 1, 2, 3, 4, 10**9]))
    with pytest.raises(ResultError, match="1000000001 rows for 6 frames"):
        posefuse.write(sparse, tmp_path / "p.h5", "sleap")
    assert list(tmp_path.iterdir()) == []


def test_what_people_are_called_leads_out_of_no_folder(tmp_path):
    names = ["../../x", "/etc/x", "a/b"]
    given = some_result(3, names, ["nose", "tail", "left_paw", "right_paw"], ["a", "b"], 6)
    (tmp_path / "in" / "out").mkdir(parents=True)
    files, _ = write_folder(given, tmp_path / "in" / "out")
    assert [file.name for file in tmp_path.rglob("*") if file.is_file() and file.parent.name != "out"] == []
    assert sorted(files) == sorted(file.name for file in (tmp_path / "in" / "out").iterdir())
    assert {"_.._x.trc", "_etc_x.trc", "a_b.trc", "_.._x.c3d"} <= set(files)
    assert posefuse.read_points(tmp_path / "in" / "out" / "keypoints.csv").person_ids == tuple(names)


class TestParquet:
    def test_pandas_reads_the_rows_of_the_csv(self, result, tmp_path):
        posefuse.write(result, tmp_path / "p.parquet")
        posefuse.write(result, tmp_path / "p.csv")
        columns = list(pandas.read_csv(tmp_path / "p.csv").columns)
        found = pandas.read_parquet(tmp_path / "p.parquet")
        assert list(found.columns[: len(columns)]) == columns
        row = found.iloc[3 * 17 + 5]
        assert (row["status"], list(row["views"])) == ("not_seen", [])
        assert list(row["view_status"]) == ["unseen"] * 4
        used = is_used(np.asarray(result.layers["solved"].view_status))[0, 0, 0]
        assert list(found.iloc[0]["views"]) == [name for name, one in zip(result.rig.names, used, strict=True) if one]

    def test_the_metadata_tell_the_cameras_and_the_layer(self, result, tmp_path):
        posefuse.write(result, tmp_path / "p.parquet")
        metadata = pyarrow.parquet.read_schema(tmp_path / "p.parquet").metadata
        said = json.loads(metadata[b"posefuse"])
        assert (said["layer"], said["unit"], said["rate_hz"]) == ("solved", "m", 60.0)
        for camera, given in zip(said["cameras"], result.rig.cameras, strict=True):
            np.testing.assert_array_equal(camera["camera_from_world"], given.camera_from_world)
        assert b"[triangulation]" in metadata[b"options"]
        assert b"min_views = 2" in metadata[b"resolved_options"]


class TestAnipose:
    def test_m_and_center_lead_to_the_calibration(self, result, tmp_path):
        turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        alignment = Alignment(turn, np.array([0.5, -0.25, 1.0]), 1.1)
        before = np.asarray(result.layers["measured"].points_m)[:, 0]
        layer = replace(result.layers["measured"], points_m=alignment.points(before)[:, None])
        rig = replace(result.rig, meters_per_unit=0.001)
        posefuse.write(
            replace(result, rig=rig, alignment=alignment, layers={"measured": layer}), tmp_path / "anipose.csv"
        )
        table = pandas.read_csv(tmp_path / "anipose.csv")
        matrix = np.array([[table[f"M_{i}{j}"][0] for j in range(3)] for i in range(3)])
        center = np.array([table[f"center_{i}"][0] for i in range(3)])
        nose = table[["nose_x", "nose_y", "nose_z"]].to_numpy()
        # As Anipose's project-3d does it: to the calibration's own unit, here millimeters.
        np.testing.assert_allclose((nose + center) @ np.linalg.inv(matrix.T), 1000.0 * before[:, 0], rtol=1e-9)

    def test_columns_are_aniposes(self, result, tmp_path):
        posefuse.write(result, tmp_path / "anipose.csv")
        table = pandas.read_csv(tmp_path / "anipose.csv")
        assert list(table.columns[:6]) == [f"nose_{kind}" for kind in ("x", "y", "z", "error", "ncams", "score")]
        assert list(table["fnum"]) == list(range(9))
        assert np.isnan(table["left_shoulder_ncams"][3])
        assert table["nose_ncams"][0] == result.layers["solved"].n_views[0, 0, 0]

    def test_a_file_of_aniposes(self, tmp_path):
        header = "a_b_x,a_b_y,a_b_z,a_b_error,a_b_ncams,a_b_score,"
        header += ",".join([*(f"M_{i}{j}" for i in range(3) for j in range(3)), "center_0,center_1,center_2", "fnum"])
        rest = "1,0,0,0,1,0,0,0,1,0,0,0"
        (tmp_path / "fly.csv").write_text(f"{header}\n1,2,3,0.5,2.0,0.9,{rest},0\n,,,,,,{rest},1\n")
        found = posefuse.read_points(tmp_path / "fly.csv")
        assert (found.keypoints, found.person_ids, found.unit, found.layer) == (("a_b",), ("fly",), "", "")
        np.testing.assert_array_equal(found.points_m[:, 0, 0], [[1, 2, 3], [np.nan] * 3])
        np.testing.assert_array_equal(found.n_views, [[[2]], [[0]]])


class TestDeepLabCut:
    def test_pandas_reads_one_and_several(self, result, people, tmp_path):
        for given, layer, levels in ((result, "solved", 3), (people, "measured", 4)):
            points = np.asarray(given.layers[layer].points_m)
            for name in ("a.h5", "a.csv"):
                posefuse.write(given, tmp_path / name, "deeplabcut")
            h5 = pandas.read_hdf(tmp_path / "a.h5")
            text = pandas.read_csv(tmp_path / "a.csv", header=list(range(levels)), index_col=0)
            names = ["scorer", "individuals", "bodyparts", "coords"]
            assert list(h5.columns.names) == [name for name in names if name != "individuals" or levels == 4]
            rows = given.frame_numbers - given.frame_numbers[0]
            np.testing.assert_array_equal(h5.to_numpy()[rows].reshape(points.shape), points)
            np.testing.assert_array_equal(text.to_numpy(), h5.to_numpy())
            assert list(text.columns) == list(h5.columns)
            assert list(h5.index) == list(range(given.frame_numbers[0], given.frame_numbers[-1] + 1))
        assert h5["posefuse_measured", "ben", "tail"].shape == (len(h5), 3)

    @pytest.mark.parametrize("layout", ["fixed", "table"])
    def test_files_that_pandas_wrote(self, layout, tmp_path):
        levels = [["net"], ["nose", "paw"], ["x", "y", "z"]]
        columns = pandas.MultiIndex.from_product(levels, names=["scorer", "bodyparts", "coords"])
        values = np.random.default_rng(0).normal(size=(5, 6))
        table = pandas.DataFrame(values, columns=columns, index=np.arange(5))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            table.to_hdf(tmp_path / "mouse.h5", key="df_with_missing", mode="w", format=layout)
        found = posefuse.read_points(tmp_path / "mouse.h5")
        assert (found.keypoints, found.person_ids) == (("nose", "paw"), ("mouse",))
        np.testing.assert_array_equal(found.points_m.reshape(5, 6), values)


class TestSleap:
    def test_tracks_are_sleap_aniposes(self, people, tmp_path):
        posefuse.write(people, tmp_path / "points3d.h5")
        points = np.asarray(people.layers["measured"].points_m)
        with h5py.File(tmp_path / "points3d.h5") as file:
            tracks = file["tracks"][:]
        assert tracks.shape == (people.frame_numbers[-1] - people.frame_numbers[0] + 1, 2, 4, 3)
        np.testing.assert_array_equal(tracks[people.frame_numbers - people.frame_numbers[0]], points)

    def test_a_file_of_sleap_aniposes(self, tmp_path):
        points = np.random.default_rng(0).normal(size=(4, 2, 3, 3))
        with h5py.File(tmp_path / "points3d.h5", "w") as file:
            file["tracks"] = points
        found = posefuse.read_points(tmp_path / "points3d.h5")
        assert found.keypoints == ("node_0", "node_1", "node_2")
        np.testing.assert_array_equal(found.points_m, points)


class TestMovement:
    @pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
    def test_xarray_and_movements_validator(self, engine, result, tmp_path):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from movement.validators.datasets import ValidPosesInputs

        posefuse.write(result, tmp_path / "movement.nc")
        with xarray.open_dataset(tmp_path / "movement.nc", engine=engine) as data:
            assert data["position"].dims == ("time", "space", "keypoint", "individual")
            one = data["position"].sel(individual="person_1", keypoint="nose")
            np.testing.assert_array_equal(one.values, solved(result)[:, 0, 0])
            assert (data.attrs["ds_type"], data.attrs["time_unit"], data.attrs["fps"]) == ("poses", "seconds", 60.0)
            np.testing.assert_allclose(data["time"].values, result.time_s)
            singular = "keypoint" in ValidPosesInputs.DIM_NAMES
            ValidPosesInputs.validate(data if singular else data.rename(keypoint="keypoints", individual="individuals"))

    def test_movement_loads_the_anipose_file(self, result, tmp_path):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from movement.io import load_poses

            posefuse.write(result, tmp_path / "anipose.csv")
            data = load_poses.from_anipose_file(tmp_path / "anipose.csv", fps=60.0)
        axis = "keypoint" if "keypoint" in data.dims else "keypoints"
        for k, name in enumerate(result.skeleton.keypoints):
            found = data["position"].sel({axis: name}).squeeze().values
            np.testing.assert_array_equal(found, solved(result)[:, 0, k])

    def test_a_file_of_an_older_movement(self, tmp_path):
        points = np.random.default_rng(0).normal(size=(4, 3, 2, 1))
        axes = ("time", "space", "keypoints", "individuals")
        names = {"time": np.arange(4) / 30, "space": list("xyz"), "keypoints": ["a", "b"], "individuals": ["id_0"]}
        data = xarray.Dataset(
            {"position": (axes, points)}, names, {"ds_type": "poses", "time_unit": "seconds", "fps": 30.0}
        )
        data.to_netcdf(tmp_path / "x.nc", engine="h5netcdf")
        found = posefuse.read_points(tmp_path / "x.nc")
        assert (found.keypoints, found.person_ids, found.rate_hz, found.status) == (("a", "b"), ("id_0",), 30.0, None)
        np.testing.assert_array_equal(found.points_m[:, 0], points[..., 0].transpose(0, 2, 1))

    def test_times_that_nobody_knows(self, people, tmp_path):
        unknown = replace(people, time_s=np.full(6, np.nan), rate_hz=None)
        posefuse.write(unknown, tmp_path / "movement.nc")
        found = posefuse.read_points(tmp_path / "movement.nc")
        assert (found.rate_hz, np.isnan(found.time_s).all()) == (None, True)
        np.testing.assert_array_equal(found.frame_numbers, people.frame_numbers)


class TestFreeMoCap:
    def test_names_and_shapes(self, tmp_path):
        skeleton = posefuse.find_skeleton("mediapipe_holistic_553")
        given = _holistic(skeleton)
        posefuse.write(given, tmp_path / "recording", "freemocap")
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
        points = 1000.0 * np.asarray(given.layers["measured"].points_m)[:, 0]
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

    def test_the_raw_array_is_the_measured_layer(self, result, tmp_path):
        posefuse.write(result, tmp_path / "a.npz")
        with np.load(tmp_path / "a.npz") as arrays:
            raw = arrays["coco_17_3dData_numFrames_numTrackedPoints_spatialXYZ"]
            np.testing.assert_array_equal(raw, 1000.0 * np.asarray(result.layers["measured"].points_m)[:, 0])
            np.testing.assert_array_equal(arrays["coco_17_skeleton_3d"], 1000.0 * solved(result)[:, 0])

    def test_a_recording_of_freemocaps_is_not_written_over(self, result, tmp_path):
        theirs = tmp_path / "recording" / "output_data" / "mediapipe_skeleton_3d.npy"
        theirs.parent.mkdir(parents=True)
        theirs.write_bytes(b"theirs")
        with pytest.raises(FileError, match="already contains other files"):
            posefuse.write(result, tmp_path / "recording", "freemocap")
        assert theirs.read_bytes() == b"theirs"

    def test_one_camera_is_no_place_in_the_world(self, tmp_path):
        rng = np.random.default_rng(0)
        rig = ring(1)
        flat = reconstruct(rig, simulate_detections(rig, body_points(rng, 2), rng), Options(solve="frame"))
        for form in ("npz", "freemocap", "anipose"):
            with pytest.raises(ResultError, match=r"this result is in px \(image plane of a single camera\)"):
                posefuse.write(flat, tmp_path / form, form)
        for name in ("a.parquet", "points3d.h5", "movement.nc"):
            posefuse.write(flat, tmp_path / name)
            assert posefuse.read_points(tmp_path / name).unit == "px"

    def test_a_bomb_is_refused(self, tmp_path, monkeypatch):
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


def read_broken(kind: str, folder: Path, cases: int) -> int:
    """Read so many broken files of a format; how many were still read."""
    given = some_result(3, ["anna"], ["nose", "tail", "left_paw", "right_paw"], ["a"], 3)
    form, name = FILES[kind]
    folder.mkdir()
    path = posefuse.write(given, folder / name, form).files[0]
    files = sorted(
        file for file in folder.rglob("*") if file.is_file() and (form != "freemocap" or file.suffix != ".csv")
    )
    files = [file for file in files if form != "freemocap" or file.stem in _READ]
    rng, read = np.random.default_rng(len(kind)), 0
    for case in range(cases):
        file = files[case % len(files)]
        original = file.read_bytes()
        file.write_bytes(broken(original, rng))
        try:
            found = posefuse.read_points(path, form)
        except PosefuseError:
            pass
        else:
            assert found.points_m.shape == (found.n_frames, len(found.person_ids), len(found.keypoints), 3)
            read += 1
        file.write_bytes(original)
    return read


_READ = (
    "posefuse", "coco_17_skeleton_3d", "chain_skeleton_3d", "frame_number", "time_s", "status", "source", "view_status",
    "covariance_m2", "reprojection_error_px", "view_error_px",
)  # fmt: skip


def test_a_heap_that_the_library_would_follow_without_end(people, tmp_path):
    posefuse.write(people, tmp_path / "movement.nc")
    content = bytearray((tmp_path / "movement.nc").read_bytes())
    at = start = content.index(b"GCOL")
    at += 16
    while content[at : at + 2] != b"\0\0":
        at += 16 + -(-int.from_bytes(content[at + 8 : at + 16], "little") // 8) * 8
    content[at + 8 : at + 16] = (8).to_bytes(8, "little")
    (tmp_path / "movement.nc").write_bytes(content)
    with pytest.raises(FileError, match=f"its strings at byte {start} are broken"):
        posefuse.read_points(tmp_path / "movement.nc", "movement")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::RuntimeWarning")
@pytest.mark.parametrize("kind", [kind for kind in FILES if kind != "nwb"])
def test_broken_files_are_errors_that_say_so(kind, tmp_path):
    assert read_broken(kind, tmp_path / "k", 200) < 200


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::RuntimeWarning")
@pytest.mark.parametrize("kind", FILES)
def test_very_many_broken_files(kind, tmp_path):
    assert read_broken(kind, tmp_path / "k", 10_000) < 10_000
