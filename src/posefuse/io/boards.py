"""Corners of a calibration board detected by other programs, read as the keypoints of one subject.

* sleap-anipose: ``*.metadata.h5`` with ``detected_corners`` (camera, frame, corner, 2) and ``frames``. The file has no
  camera names; the cameras are those of the calibration, in its order.
* Caliscope: ``xy.csv`` with ``sync_index, port, point_id, img_loc_x, img_loc_y`` of a ChArUco board.

Corners that were not detected are missing, as are corners at (0, 0).
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
    """Return the only file of board corners in a recording's folder, or the path itself if it is a file.

    Raises:
        FileError: If the path does not exist.
        RecordingError: If the folder has no such file, or more than one.
    """
    must_exist(folder, "recording")
    if folder.is_file():
        return folder
    files = sorted({file for pattern in _PATTERNS for file in folder.glob(pattern)}, key=lambda f: natural_key(str(f)))
    files = [file for file in files if matches(file)]
    if len(files) != 1:
        listed = "".join(f"\n  `keypoints={str(file)!r}`" for file in files)
        raise RecordingError(
            f"{folder} has {len(files) or 'no'} files of board corners. posefuse reads sleap-anipose's *.metadata.h5 "
            f"and Caliscope's xy.csv. {'Choose one:' + listed if files else 'Specify one with `keypoints`.'}"
        )
    return files[0]


def matches(path: Path) -> bool:
    """Return whether a file contains board corners."""
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
    """Read the corners of a board as keypoints of one subject, in px.

    Args:
        path: The file.
        camera_names: Names of the calibrated cameras, in order. They name the views of files without camera names.

    Raises:
        FileError: If the file does not exist, is broken, or has a different number of cameras than the calibration.
    """
    path = must_exist(Path(path), "file of board corners")
    if not matches(path):
        raise FileError(
            f"{path} contains no board corners. Supported files: *.metadata.h5 of sleap-anipose with the dataset "
            f"detected_corners, and *.csv of Caliscope with the columns {choices(_COLUMNS)}."
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
            f"{path} has board corners of {len(corners)} unnamed cameras, but the calibration has "
            f"{len(camera_names)}: {choices(camera_names)}. The numbers of cameras must be equal."
        )
    return _detections(tuple(camera_names), frames, np.moveaxis(corners, 0, 1))


def _from_csv(path: Path) -> Detections:
    with path.open(encoding="utf-8", newline="") as stream:
        rows = [[row[column] for column in _COLUMNS[:5]] for row in csv.DictReader(stream)]
    if not rows:
        raise FileError(f"{path} has no rows: no camera detected the board.")
    table = np.array(rows, dtype=np.float64)
    frames, frame = np.unique(table[:, 0].astype(np.int64), return_inverse=True)
    ports, view = np.unique(table[:, 1].astype(np.int64), return_inverse=True)
    corner = table[:, 2].astype(np.int64)
    if corner.min() < 0 or corner.max() > 10_000:
        raise FileError(f"{path}: point_id ranges from {corner.min()} to {corner.max()}; expected 0 to at most 10,000.")
    pixels = np.full((len(frames), len(ports), int(corner.max()) + 1, 2), np.nan)
    pixels[frame, view, corner] = table[:, 3:5]
    return _detections(tuple(str(port) for port in ports), frames, pixels)


def _detections(views: tuple[str, ...], frames: np.ndarray, pixels: np.ndarray) -> Detections:
    missing = np.isnan(pixels).any(axis=-1) | (pixels == 0.0).all(axis=-1)
    pixels = np.where(missing[..., None], np.nan, pixels)
    names = tuple(f"corner_{i}" for i in range(pixels.shape[2]))
    return Detections.from_dense(Skeleton("board", names), views, pixels, frame_numbers=frames)
