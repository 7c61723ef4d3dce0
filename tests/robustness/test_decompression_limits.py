"""Decompression bombs, nested compression and links to other files are refused with a message."""

import zlib
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import posefuse
from posefuse.errors import FileError
from posefuse.io.boards import read_board
from posefuse.io.keypoints import tidy
from posefuse.io.parquet_files import check_parquet, check_row_groups
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests import keypoint_files
from tests.example_detections import example_detections

HUGE = 10**9


@pytest.fixture(scope="module")
def result():
    scene = simulate(SceneOptions(skeleton="coco_17", duration_s=0.1, cameras=2, detector=CLEAN))
    return scene.truth


def declare(path: Path, name: str, shape: tuple[int, ...], **storage) -> None:
    """Replace an array by one with another shape, without any stored data."""
    with h5py.File(path, "a") as file:
        if name in file:
            del file[name]
        file.create_dataset(name, shape, np.float64, **({"chunks": (1,) * len(shape)} | storage))


def refused(path: Path, words: str = "would expand to") -> None:
    if path.name == "reconstruction.nc":
        read = posefuse.read_reconstruction
    elif path.name in ("points3d.h5", "points_dlc.h5", "movement.nc", "points.parquet"):
        read = posefuse.read_points
    else:
        read = posefuse.read_detections
    with pytest.raises(FileError, match=words) as error:
        read(path)
    assert path.name in str(error.value) or path.is_dir()


@pytest.mark.parametrize(
    ("form", "name", "array"),
    [
        ("sleap", "points3d.h5", "tracks"), ("deeplabcut", "points_dlc.h5", "posefuse/covariance"),
        ("deeplabcut", "points_dlc.h5", "df_with_missing/block0_values"), ("movement", "movement.nc", "position"),
        ("netcdf", "reconstruction.nc", "frame_number"), ("netcdf", "reconstruction.nc", "anything"),
    ],
)  # fmt: skip
def test_results_that_declare_gigabytes_are_refused(form, name, array, result, tmp_path):
    path = posefuse.write(result, tmp_path / name, form).files[0]
    declare(path, array, (HUGE,))
    refused(path)


def test_chunks_of_arrays_that_are_read_by_ranges_are_limited(result, tmp_path):
    path = posefuse.write(result, tmp_path / "reconstruction.nc", "netcdf").files[0]
    with h5py.File(path, "a") as file:
        shape = (HUGE, *file["measured_position"].shape[1:])
    declare(path, "another", shape, chunks=(1, *shape[1:]))
    posefuse.read_reconstruction(path)
    declare(path, "another", shape, chunks=(10**7, *shape[1:]))
    refused(path)


def test_keypoints_that_declare_gigabytes_are_refused(tmp_path):
    own = keypoint_files.own(example_detections(), tmp_path / "own")
    declare(own, "time_s", (HUGE, 2))
    refused(own)
    for writer, array, shape in (
        (keypoint_files.sleap, "tracks", (2, 2, 17, HUGE)),
        (keypoint_files.deeplabcut_h5, "df_with_missing/more", (HUGE,)),
    ):
        folder = writer(example_detections(), tmp_path / writer.__name__)
        declare(next(folder.iterdir()), array, shape)
        refused(folder)
    project = keypoint_files.slp(example_detections(), tmp_path / "slp")
    declare(project, "more", (HUGE,))
    refused(project)


def test_boards_that_declare_gigabytes_are_refused(tmp_path):
    declare(tmp_path / "calibration.metadata.h5", "detected_corners", (2, HUGE, 4, 2))
    with pytest.raises(FileError, match="would expand to"):
        read_board(tmp_path / "calibration.metadata.h5", ("a", "b"))


def test_nested_compression_and_external_data_are_refused(result, tmp_path):
    path = tmp_path / "points3d.h5"

    def fresh() -> h5py.File:
        posefuse.write(result, path, "sleap", overwrite=True)
        return h5py.File(path, "a")

    with fresh() as file:
        plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plist.set_chunk((1000,))
        plist.set_deflate(9)
        plist.set_deflate(9)
        h5py.h5d.create(file.id, b"more", h5py.h5t.NATIVE_DOUBLE, h5py.h5s.create_simple((1000,)), plist)
    refused(path, "more is compressed 2 times")
    with fresh() as file:
        file["more"] = h5py.ExternalLink("/etc/other.h5", "secret")
    refused(path, "more links to another file, '/etc/other.h5'")
    with fresh() as file:
        file.create_dataset("more", (100,), "i1", external=[("/etc/hostname", 0, 100)])
    refused(path, "the data of more is stored in another file")
    with fresh() as file:
        layout = h5py.VirtualLayout((100,), "i1")
        layout[:] = h5py.VirtualSource("/tmp/other.h5", "secret", (100,))
        file.create_virtual_dataset("more", layout)
    refused(path, "the data of more is stored in another file")
    fresh().close()
    assert posefuse.read_points(path).n_frames == result.n_frames


def runs(rows: int, names: tuple[str, ...], kinds: dict[str, pa.Array]) -> pa.Table:
    """Return a table in which every row has the same value."""
    dictionary = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), pa.array([0.0]))
    return pa.table({name: kinds.get(name, dictionary) for name in names})


def test_parquet_of_run_lengths_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("posefuse.io.files._LARGE_BYTES", 10**7)
    rows = 2 * 10**6
    words = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), pa.array(["a"]))
    columns = ("camera", "frame", "keypoint", "x_px", "y_px")
    pq.write_table(runs(rows, columns, {"camera": words, "keypoint": words}), tmp_path / "tidy.parquet")
    refused(tmp_path / "tidy.parquet")
    pq.write_table(runs(rows, ("frame_index", "kps", "kps_scores"), {}), tmp_path / "table.parquet")
    refused(tmp_path / "table.parquet")
    pq.write_table(runs(rows, ("R", "T", "fx", "fy", "cx", "cy"), {}), tmp_path / "camera_params.parquet")
    with pytest.raises(FileError, match="would expand to"):
        posefuse.read_cameras(tmp_path / "camera_params.parquet")
    table = runs(rows, columns, {}).replace_schema_metadata({"posefuse": "{}"})
    pq.write_table(table, tmp_path / "points.parquet")
    refused(tmp_path / "points.parquet")


@pytest.mark.parametrize("own", [False, True])
def test_parquet_with_one_long_string_in_every_row_is_refused(own, tmp_path, monkeypatch):
    monkeypatch.setattr("posefuse.io.files._LARGE_BYTES", 10**7)
    path, rows = tmp_path / "tidy.parquet", 2 * 10**4
    if own:
        tidy.write(example_detections(), path)
        results = pq.read_schema(path).metadata
    places = pa.array(np.zeros(rows, np.int32))

    def texts(text: str) -> pa.Array:
        return pa.DictionaryArray.from_arrays(places, pa.array([text]))

    numbers = {name: pa.array(np.zeros(rows)) for name in ("frame", "x_px", "y_px", "confidence", "time_s", "track")}
    for length, fine in ((3, True), (20_000, False)):
        table = pa.table({"camera": texts("a" * length), "keypoint": texts("nose"), **numbers})
        pq.write_table(table.replace_schema_metadata(results if own else None), path)
        check = check_row_groups if own else check_parquet
        if fine:
            check(path)
            continue
        with pytest.raises(FileError, match="would expand to 4000"):
            check(path)
        refused(path)


def test_chunk_with_too_much_content_is_refused(result, tmp_path, monkeypatch):
    path = posefuse.write(result, tmp_path / "points3d.h5", "sleap").files[0]
    with h5py.File(path, "a") as file:
        data = file.create_dataset("more", (1000,), "f8", chunks=(1000,), compression="gzip", fletcher32=True)
        data[:] = np.random.default_rng(0).normal(size=1000)
    monkeypatch.setattr("posefuse.io.files._LARGE_BYTES", 10**6)
    monkeypatch.setattr("posefuse.io.files._MAX_UNPACKED_RATIO", 2)
    posefuse.read_points(path)
    with h5py.File(path, "a") as file:
        file["more"].id.write_direct_chunk((0,), zlib.compress(bytes(4 * 10**7)))
    refused(path, r"a chunk of more at \(0,\) exceeds 8004 bytes")


def test_small_compressed_zeros_are_read(tmp_path):
    """Content below the absolute limit is no bomb, whatever its compression ratio."""
    path = tmp_path / "zeros.npz"
    np.savez_compressed(path, keypoints=np.zeros((2, 10**4, 17, 2)), names=["a", "b"], rate_hz=30.0)
    assert path.stat().st_size * 200 < 2 * 10**4 * 17 * 2 * 8
    assert posefuse.read_detections(path, "coco_17").n_frames == 10**4
