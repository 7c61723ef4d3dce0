"""Caliscope's tracked points: ``xy_*.csv``, one row per point, all cameras of a recording in one file.

Columns are ``sync_index, port, frame_index, frame_time, point_id, img_loc_x, img_loc_y``, in newer files ``cam_id`` and
``keypoint_id``. Frames are the sync indices; ``frame_time`` is the capture time of a camera, in s. Views are named
``cam_<port>`` as in ``config.toml``. Positions are in pixels of the stored image, without confidence. Points 0 to 32
are MediaPipe's body; those of hands and face, from 100 on, are ignored with a note. There is one person; in newer files
``object_id`` identifies people, and is their track if there are several.
"""

import csv
import math
from pathlib import Path

import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.files import reading
from posefuse.io.keypoints.columns import ViewColumns, assemble, with_times_from_start
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import find_skeleton

_COLUMNS = ("sync_index", "port", "frame_index", "frame_time", "point_id", "img_loc_x", "img_loc_y")
_NEWER = {"port": "cam_id", "point_id": "keypoint_id"}
_OBJECT = "object_id"
_INTEGER_COLUMNS = (0, 1, 4, 7)
_MAX_INTEGER = 2.0**40
_SKELETON = "mediapipe_33"


def matches(path: Path) -> bool:
    """Return whether a path is a file in this format or a folder that contains one."""
    return bool(files_of(path))


def files_of(path: Path) -> list[Path]:
    """Return the files in the order of their names."""
    files = sorted(path.glob("xy*.csv")) if path.is_dir() else [path]
    return [file for file in files if file.suffix == ".csv" and file.is_file() and _is_one(file)]


def _is_one(file: Path) -> bool:
    with file.open(encoding="utf-8-sig", errors="replace") as lines:
        return _column_indices(lines.readline(10_000).strip().split(",")) is not None


def _column_indices(header: list[str]) -> list[int] | None:
    """Return the index of each column, with that of objects last if it exists, or None if another is missing."""
    names = [_NEWER.get(name, name) if _NEWER.get(name, name) in header else name for name in _COLUMNS]
    if not all(name in header for name in names):
        return None
    return [header.index(name) for name in [*names, *([_OBJECT] if _OBJECT in header else [])]]


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: If there is not exactly one file, or it contains something other than numbers.
    """
    files = files_of(path)
    if not files:
        raise FileError(f"{path} is not a Caliscope point file: expected the first line {','.join(_COLUMNS)}.")
    if len(files) > 1:
        raise FileError(f"{path} contains several recordings: {choices([file.name for file in files])}. Choose one.")
    (file,) = files
    skeleton = request.skeleton or find_skeleton(_SKELETON)
    table = _read_table(file)
    body = table[:, 4] < len(skeleton)
    views = [_view(table, body, port, len(skeleton), request) for port in np.unique(table[:, 1])]
    notes: tuple[str, ...] = ()
    if not body.all():
        notes = (f"{int((~body).sum())} observations of hands and face are ignored; {skeleton.name} has none.",)
    views, begin_s = with_times_from_start(views)
    if begin_s:
        notes = (*notes, f"Time 0 corresponds to {begin_s} s in {file.name}.")
    rate_hz = request.rate_hz or _rate_hz(table)
    return assemble(path, views, skeleton, rate_hz, notes)


def _read_table(file: Path) -> np.ndarray:
    """Return the columns and the object, shape (row, 8). The object is 0 if the file has no objects."""
    table = []
    with reading(file, "CSV file in UTF-8"), file.open(newline="", encoding="utf-8-sig") as lines:
        rows = (row for row in csv.reader(lines) if row)
        indices = _column_indices(next(rows)) or []
        for number, row in enumerate(rows, start=2):
            values = _numbers(row, indices)
            if values is None:
                raise FileError(
                    f"{file}, line {number}: expected {len(_COLUMNS)} numbers ({', '.join(_COLUMNS)}), integers for "
                    f"{', '.join((*_COLUMNS, _OBJECT)[i] for i in _INTEGER_COLUMNS)}, got {','.join(row)!r}. Is the "
                    "file truncated?"
                )
            table.append(values)
    if not table:
        raise FileError(f"{file} contains no points.")
    return np.array(table)


def _numbers(row: list[str], indices: list[int]) -> list[float] | None:
    """Return the numbers of a line, or None if the line is invalid."""
    try:
        objects = [float(row[i] or 0.0) for i in indices[len(_COLUMNS) :]]
        values = [*(float(row[i]) for i in indices[: len(_COLUMNS)]), *(objects or [0.0])]
    except (ValueError, IndexError):
        return None
    valid = all(0.0 <= values[i] < _MAX_INTEGER and values[i].is_integer() for i in _INTEGER_COLUMNS)
    return values if valid and all(math.isfinite(value) for value in values) else None


def _view(table: np.ndarray, body: np.ndarray, port: float, n_keypoints: int, request: Request) -> ViewColumns:
    in_view = table[:, 1] == port
    recorded, first = np.unique(table[in_view, 0], return_index=True)
    rows = table[in_view & body]
    people, row = np.unique(rows[:, [0, 7]], axis=0, return_inverse=True)
    keypoints = np.full((len(people), n_keypoints, 3), np.nan)
    keypoints[row.ravel(), rows[:, 4].astype(np.int64), :2] = rows[:, 5:7]
    several = len(np.unique(table[body, 7])) > 1
    return ViewColumns(
        name=f"cam_{int(port)}",
        recorded=recorded.astype(np.int64),
        frame_of_row=people[:, 0].astype(np.int64),
        keypoints=keypoints,
        track_ids=people[:, 1].astype(np.int64) if several else np.full(len(people), -1, dtype=np.int64),
        time_s=None if request.rate_hz else table[in_view, 3][first],
    )


def _rate_hz(table: np.ndarray) -> float | None:
    """Return the frame rate from the intervals between consecutive frames of a camera, or None."""
    first = table[table[:, 1] == table[0, 1]]
    _, place = np.unique(first[:, 0], return_index=True)
    steps, times = np.diff(first[place, 0]), np.diff(first[place, 3])
    consecutive = (steps == 1) & (times > 0)
    return round(float(1.0 / np.median(times[consecutive])), 3) if consecutive.any() else None


FORMAT = KeypointFormat(
    name="caliscope",
    files="xy_*.csv",
    conventions=(
        "px; one row per point, all cameras in one file; one person with MediaPipe's body; times; no confidence"
    ),
    recognized_by="columns sync_index, port (cam_id), frame_time, point_id, img_loc_x, img_loc_y",
    matches=matches,
    read=read,
    camera_files=files_of,
)
