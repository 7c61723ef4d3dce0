"""Broken files of formats that other tests do not write: every damage leads to a PosefuseError or a valid result."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pandas
import pytest
import xarray

from posefuse import read_cameras, read_detections, read_points
from posefuse.errors import PosefuseError
from posefuse.io.boards import read_board
from posefuse.io.timestamps import read_timestamps
from tests.broken import broken
from tests.layouts import freemocap, operating_room
from tests.unit.io.keypoints import test_caliscope

Case = tuple[Path, Callable[[], object]]


def mvor_cameras(folder: Path) -> Case:
    operating_room(folder)
    return folder / "camma_mvor_2018.json", lambda: read_cameras(folder / "camma_mvor_2018.json")


def mvor_annotations(folder: Path) -> Case:
    operating_room(folder)
    return folder / "camma_mvor_2018.json", lambda: read_detections(folder / "camma_mvor_2018.json")


def mvor_detections(folder: Path) -> Case:
    operating_room(folder)
    return folder / "openpose_kps.json", lambda: read_detections(folder / "openpose_kps.json")


def arrays_of_cameras(folder: Path) -> Case:
    path = folder / "cameras.npz"
    lens = np.array([[900.0, 0.0, 640.0], [0.0, 900.0, 480.0], [0.0, 0.0, 1.0]])
    np.savez(path, K=np.stack([lens] * 2), R=np.stack([np.eye(3)] * 2), t=np.arange(6.0).reshape(2, 3))
    return path, lambda: read_cameras(path)


def deepfly(folder: Path) -> Case:
    np.savez(folder / "points2d.npz", points2d_px=np.ones((2, 3, 38, 2)))
    return folder / "points2d.npz", lambda: read_detections(folder / "points2d.npz")


def array(folder: Path) -> Case:
    np.save(folder / "points.npy", np.ones((2, 3, 25, 2)))
    return folder / "points.npy", lambda: read_detections(folder / "points.npy", "body_25")


def packed_arrays(folder: Path) -> Case:
    path, rng = folder / "points.npz", np.random.default_rng(0)
    pixels, trust = rng.uniform(0, 999, (2, 3, 17, 2)), rng.uniform(size=(2, 3, 17))
    np.savez_compressed(path, keypoints=pixels, confidence=trust, names=["a", "b"], rate_hz=30.0)
    return path, lambda: read_detections(path, "coco_17")


def freemocap_arrays(folder: Path) -> Case:
    freemocap(folder)
    path = next((folder / "output_data" / "raw_data").glob("*2dData*"))
    return path, lambda: read_detections(folder)


def caliscope(folder: Path) -> Case:
    rows = [(f, c, f, 9 + 0.04 * f, k, 10 * k + c, 20 * k + f) for f in range(4) for c in (0, 1) for k in range(9)]
    test_caliscope.write(folder / "xy_POSE.csv", rows)
    return folder / "xy_POSE.csv", lambda: read_detections(folder)


def board_of_sleap_anipose(folder: Path) -> Case:
    path = folder / "calibration.metadata.h5"
    with h5py.File(path, "w") as file:
        file["detected_corners"], file["frames"] = np.ones((2, 3, 4, 2)), [5, 7, 9]
    return path, lambda: read_board(path, ("a", "b"))


def board_of_caliscope(folder: Path) -> Case:
    header = "sync_index,port,point_id,img_loc_x,img_loc_y,obj_loc_x,obj_loc_y"
    lines = [f"{f},{c},{k},{k + 5},9,0,0" for f in range(4) for c in (0, 1) for k in range(3)]
    (folder / "xy.csv").write_text("\n".join([header, *lines]) + "\n")
    return folder / "xy.csv", lambda: read_board(folder / "xy.csv", ("0", "1"))


def times_in_a_table(folder: Path) -> Case:
    lines = [f"{view},{f},{f / 30}" for view in "ab" for f in range(20)]
    (folder / "times.csv").write_text("\n".join(["camera,frame,time_s", *lines]) + "\n")
    return folder / "times.csv", lambda: read_timestamps(folder / "times.csv")


def times_in_arrays(folder: Path) -> Case:
    (folder / "timestamps").mkdir()
    for view in "ab":
        np.save(folder / "timestamps" / f"{view}.npy", np.arange(20) / 30)
    return folder / "timestamps" / "a.npy", lambda: read_timestamps(folder / "timestamps")


def points_of_sleap_anipose(folder: Path) -> Case:
    with h5py.File(folder / "points3d.h5", "w") as file:
        file["tracks"] = np.ones((4, 2, 3, 3))
    return folder / "points3d.h5", lambda: read_points(folder / "points3d.h5")


def points_of_an_older_movement(folder: Path) -> Case:
    axes = ("time", "space", "keypoints", "individuals")
    names = {"time": np.arange(4) / 30, "space": list("xyz"), "keypoints": ["a", "b"], "individuals": ["id_0"]}
    attributes = {"ds_type": "poses", "time_unit": "seconds", "fps": 30.0}
    points = xarray.Dataset({"position": (axes, np.ones((4, 3, 2, 1)))}, names, attributes)
    points.to_netcdf(folder / "movement.nc", engine="h5netcdf")
    return folder / "movement.nc", lambda: read_points(folder / "movement.nc")


def points_of_deeplabcut(folder: Path) -> Case:
    columns = pandas.MultiIndex.from_product([["net"], ["nose", "tail"], list("xyz")])
    columns.names = ["scorer", "bodyparts", "coords"]
    pandas.DataFrame(np.ones((4, 6)), columns=columns).to_csv(folder / "points.csv")
    return folder / "points.csv", lambda: read_points(folder / "points.csv")


CASES = (
    mvor_cameras, mvor_annotations, mvor_detections, arrays_of_cameras, deepfly, array, packed_arrays, freemocap_arrays,
    caliscope, board_of_sleap_anipose, board_of_caliscope, times_in_a_table, times_in_arrays, points_of_sleap_anipose,
    points_of_an_older_movement, points_of_deeplabcut,
)  # fmt: skip


def refused(case: Callable[[Path], Case], folder: Path, cases: int) -> int:
    """Return how many of the broken files are refused. Any other exception is an error of the reader."""
    path, read = case(folder)
    read()
    original, rng, n = path.read_bytes(), np.random.default_rng(9), 0
    for _ in range(cases):
        path.write_bytes(broken(original, rng))
        try:
            read()
        except PosefuseError:
            n += 1
    return n


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::RuntimeWarning")
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_broken_files_raise_posefuse_errors(case, tmp_path):
    assert refused(case, tmp_path, 200) > 30


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::RuntimeWarning")
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_many_broken_files_raise_posefuse_errors(case, tmp_path):
    assert refused(case, tmp_path, 10_000) > 1500
