"""Corners of a calibration board, as other programs found them, read as keypoints; the board is the one subject.

* sleap-anipose: ``*.metadata.h5`` with ``detected_corners`` (camera, frame, corner, 2) and ``frames``; the file names
  no cameras, they are the calibration's, in its order.
* Caliscope: ``xy.csv`` with ``sync_index, port, point_id, img_loc_x, img_loc_y`` of a charuco board.

Corners that were not seen are missing; those at (0, 0) too.
"""

import csv
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from posefuse.errors import FileError, RecordingError, choices
from posefuse.io.files import must_exist, natural_key, reading
from posefuse.io.hdf5 import open_hdf5
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton

_COLUMNS = ("sync_index", "port", "point_id", "img_loc_x", "img_loc_y", "obj_loc_x", "obj_loc_y")
_PATTERNS = ("*.metadata.h5", "*/*.metadata.h5", "xy.csv", "calibration/extrinsic/xy.csv", "extrinsic/xy.csv")


def find_board(folder: Path) -> Path:
    """The one file of board corners in a recording's folder.

    Raises:
        RecordingError: if there is none, or more than one.
    """
    must_exist(folder, "recording")
    if folder.is_file():
        return folder
    found = sorted({file for pattern in _PATTERNS for file in folder.glob(pattern)}, key=lambda f: natural_key(str(f)))
    found = [file for file in found if matches(file)]
    if len(found) != 1:
        listed = "".join(f"\n  --keypoints {file}" for file in found)
        raise RecordingError(
            f"{folder} has {len(found) or 'no'} files of board corners; "
            f"{'choose one:' + listed if found else 'give one with --keypoints.'} Known are sleap-anipose's "
            "*.metadata.h5 and Caliscope's xy.csv."
        )
    return found[0]


def matches(path: Path) -> bool:
    """Whether a file holds board corners."""
    try:
        if path.suffix == ".h5":
            with h5py.File(path) as content:
                return "detected_corners" in content
        if path.suffix == ".csv":
            with path.open(encoding="utf-8", newline="") as stream:
                return set(_COLUMNS) <= set(next(csv.reader(stream), []))
    except (OSError, KeyError, ValueError, RuntimeError):
        return False
    return False


def read_board(path: str | Path, camera_names: Sequence[str]) -> Detections:
    """Read the corners.

    Args:
        path: the file.
        camera_names: of the calibration, in its order; they name the views of files that name none.

    Raises:
        FileError: if the file is not what its format says, or has another number of cameras.
    """
    path = must_exist(Path(path), "file of board corners")
    if not matches(path):
        raise FileError(
            f"{path} holds no board corners: expected sleap-anipose's *.metadata.h5 with detected_corners, or "
            f"Caliscope's *.csv with {choices(_COLUMNS)}."
        )
    with reading(path, "file of board corners"):
        return _from_csv(path) if path.suffix == ".csv" else _from_h5(path, camera_names)


def _from_h5(path: Path, camera_names: Sequence[str]) -> Detections:
    with open_hdf5(path, "file of board corners") as content:
        corners = np.asarray(content["detected_corners"], dtype=np.float64)
        frames = np.asarray(content["frames"]) if "frames" in content else np.arange(corners.shape[1])
    if corners.ndim != 4 or corners.shape[3] != 2 or len(frames) != corners.shape[1]:
        raise FileError(f"{path}: expected detected_corners (camera, frame, corner, 2), got {corners.shape}.")
    if len(corners) != len(camera_names):
        raise FileError(
            f"{path} has corners of {len(corners)} cameras and does not name them; the calibration has "
            f"{len(camera_names)}: {choices(camera_names)}. They belong together if they are as many."
        )
    return _detections(tuple(camera_names), frames, np.moveaxis(corners, 0, 1))


def _from_csv(path: Path) -> Detections:
    with path.open(encoding="utf-8", newline="") as stream:
        rows = [[row[column] for column in _COLUMNS[:5]] for row in csv.DictReader(stream)]
    if not rows:
        raise FileError(f"{path} has no rows: no board was seen.")
    table = np.array(rows, dtype=np.float64)
    frames, frame = np.unique(table[:, 0].astype(np.int64), return_inverse=True)
    ports, view = np.unique(table[:, 1].astype(np.int64), return_inverse=True)
    corner = table[:, 2].astype(np.int64)
    if corner.min() < 0 or corner.max() > 10_000:
        raise FileError(f"{path}: point_id runs from {corner.min()} to {corner.max()}; a board has fewer corners.")
    pixels = np.full((len(frames), len(ports), int(corner.max()) + 1, 2), np.nan)
    pixels[frame, view, corner] = table[:, 3:5]
    return _detections(tuple(str(port) for port in ports), frames, pixels)


def _detections(views: tuple[str, ...], frames: np.ndarray, pixels: np.ndarray) -> Detections:
    missing = np.isnan(pixels).any(axis=-1) | (pixels == 0.0).all(axis=-1)
    pixels = np.where(missing[..., None], np.nan, pixels)
    names = tuple(f"corner_{i}" for i in range(pixels.shape[2]))
    return Detections.from_dense(Skeleton("board", names), views, pixels, frame_numbers=frames)
