"""Caliscope's tracked points: ``xy_*.csv``, a row a point, of all cameras of a recording.

Columns ``sync_index, port, frame_index, frame_time, point_id, img_loc_x, img_loc_y``, in newer files ``cam_id`` and
``keypoint_id``; frames are the sync indices, ``frame_time`` is when a camera truly took its frame, seconds. Views are
named ``cam_<port>`` as in its ``config.toml``. Pixels of the image as it was stored, no confidence. Points 0
to 32 are MediaPipe's body; those of hands and face, from 100 on, are left out with a note. One person; in newer files
``object_id`` tells people apart, and is their track where there are several.
"""

import csv
import math
from pathlib import Path

import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.files import reading
from posefuse.io.keypoints.columns import ViewColumns, assemble, counted_from_start
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import find_skeleton

_COLUMNS = ("sync_index", "port", "frame_index", "frame_time", "point_id", "img_loc_x", "img_loc_y")
_NEWER = {"port": "cam_id", "point_id": "keypoint_id"}
_OBJECT = "object_id"
_WHOLE = (0, 1, 4, 7)
_LARGEST = 2.0**40
_SKELETON = "mediapipe_33"


def matches(path: Path) -> bool:
    """Whether a file is one, or a folder holds one."""
    return bool(files_of(path))


def files_of(path: Path) -> list[Path]:
    """The files, in the order of their names."""
    found = sorted(path.glob("xy*.csv")) if path.is_dir() else [path]
    return [file for file in found if file.suffix == ".csv" and file.is_file() and _is_one(file)]


def _is_one(file: Path) -> bool:
    with file.open(encoding="utf-8-sig", errors="replace") as lines:
        return _places(lines.readline(10_000).strip().split(",")) is not None


def _places(header: list[str]) -> list[int] | None:
    """Where in a line each of the columns is, that of objects last if there is one; None where another is lacking."""
    names = [_NEWER.get(name, name) if _NEWER.get(name, name) in header else name for name in _COLUMNS]
    if not all(name in header for name in names):
        return None
    return [header.index(name) for name in [*names, *([_OBJECT] if _OBJECT in header else [])]]


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: if there are several files, or one holds other than numbers.
    """
    files = files_of(path)
    if not files:
        raise FileError(f"{path} is no file of Caliscope's points: its first line should be {','.join(_COLUMNS)}.")
    if len(files) > 1:
        raise FileError(f"{path} holds several recordings: {choices([file.name for file in files])}. Name one.")
    (file,) = files
    skeleton = request.skeleton or find_skeleton(_SKELETON)
    table = _read_table(file)
    body = table[:, 4] < len(skeleton)
    views = [_view(table, body, port, len(skeleton), request) for port in np.unique(table[:, 1])]
    notes: tuple[str, ...] = ()
    if not body.all():
        notes = (f"{int((~body).sum())} observations of hands and face are left out; {skeleton.name} has none.",)
    views, begin_s = counted_from_start(views)
    if begin_s:
        notes = (*notes, f"Times count from second {begin_s} of {file.name}.")
    rate_hz = request.rate_hz or _rate_hz(table)
    return assemble(path, views, skeleton, rate_hz, notes)


def _read_table(file: Path) -> np.ndarray:
    """Shape (row, 8): the columns, and the object, 0 where the file tells none apart."""
    table = []
    with reading(file, "CSV file in UTF-8"), file.open(newline="", encoding="utf-8-sig") as lines:
        rows = (row for row in csv.reader(lines) if row)
        places = _places(next(rows)) or []
        for number, row in enumerate(rows, start=2):
            values = _numbers(row, places)
            if values is None:
                raise FileError(
                    f"{file}, line {number}: expected {len(_COLUMNS)} numbers ({', '.join(_COLUMNS)}), whole ones for "
                    f"{', '.join((*_COLUMNS, _OBJECT)[i] for i in _WHOLE)}, got {','.join(row)!r}. Is the file truncated?"
                )
            table.append(values)
    if not table:
        raise FileError(f"{file} holds no points.")
    return np.array(table)


def _numbers(row: list[str], places: list[int]) -> list[float] | None:
    """The numbers of a line, or None where it does not hold them."""
    try:
        objects = [float(row[place] or 0.0) for place in places[len(_COLUMNS) :]]
        values = [*(float(row[place]) for place in places[: len(_COLUMNS)]), *(objects or [0.0])]
    except (ValueError, IndexError):
        return None
    whole = all(0.0 <= values[i] < _LARGEST and values[i].is_integer() for i in _WHOLE)
    return values if whole and all(math.isfinite(value) for value in values) else None


def _view(table: np.ndarray, body: np.ndarray, port: float, n_keypoints: int, request: Request) -> ViewColumns:
    mine = table[:, 1] == port
    recorded, first = np.unique(table[mine, 0], return_index=True)
    rows = table[mine & body]
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
        time_s=None if request.rate_hz else table[mine, 3][first],
    )


def _rate_hz(table: np.ndarray) -> float | None:
    """From the times that a camera took consecutive frames."""
    first = table[table[:, 1] == table[0, 1]]
    _, place = np.unique(first[:, 0], return_index=True)
    steps, times = np.diff(first[place, 0]), np.diff(first[place, 3])
    known = (steps == 1) & (times > 0)
    return round(float(1.0 / np.median(times[known])), 3) if known.any() else None


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
