"""Timestamps of the frames of each view: one table for all views, or a folder with one file per view.

Tables (``.csv``) have a column with the view (``camera``, ``view``, ``port``, ...), one with the frame number
(``frame``, ``frame_index``, ``sync_index``, ...), and one with the time: ``time_s``, ``frame_time`` or ``timestamp`` in
seconds, or with the suffix ``_ms``, ``_us`` or ``_ns``. Without a frame column, the rows of a view are its frames in
order. Caliscope's ``frame_time_history.csv`` is such a table.

A folder (FreeMoCap's ``timestamps``) contains per view a ``.npy`` file with one time per frame, or such a table without
the view column. The files are named after the views. Arrays do not state their unit; it is inferred from the interval
between frames, which is between 1 ms and 1 s. FreeMoCap 1.8 writes ``<video>_binary.npy``: nanoseconds of one clock of
the computer, shape (frame,). A camera that delivers frames more slowly repeats a frame and its time.
"""

import csv
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.files import must_exist, natural_key, reading

_VIEWS = ("camera", "view", "cam", "cam_id", "camera_id", "camera_name", "port")
_FRAMES = ("frame", "frame_index", "frame_number", "frame_id", "sync_index")
_TIMES = {
    f"{name}{unit}": scale
    for name in ("time", "frame_time", "timestamp")
    for unit, scale in (("", 1.0), ("_s", 1.0), ("_ms", 1e-3), ("_us", 1e-6), ("_ns", 1e-9))
}
_MAX_COLUMNS = 8
_MAX_FILES = 300
_MIN_INTERVAL_S = 1e-3
_MAX_FRAME = 2**40
_NAME_SUFFIX = re.compile(r"(_binary|[_\-. ]*(unix)?[_\-. ]*time[_\-]?stamps?.*)$", re.IGNORECASE)
"""What follows the name of the view in the name of a file with its times."""


@dataclass(frozen=True, eq=False)
class ViewTimes:
    """Timestamps of one view.

    Attributes:
        frames: Shape (n,), int64, ascending frame numbers, or None if the times are those of the view's frames in
            order.
        time_s: Shape (n,), s.
    """

    frames: np.ndarray | None
    time_s: np.ndarray


@dataclass(frozen=True, eq=False)
class Timestamps:
    """Timestamps of all views of a file or folder.

    Attributes:
        source: Name of the file or folder, for messages.
        by_view: Timestamps by the name of the view in the source.
        notes: Sentences for the user, such as the inferred unit.
    """

    source: str
    by_view: dict[str, ViewTimes]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Columns:
    view: int | None
    frame: int | None
    time: int
    scale: float


def matches(path: Path) -> bool:
    """Return whether a path is a table of timestamps of several views or a folder with one file per view."""
    if path.is_dir():
        return "timestamp" in path.name.lower() and bool(_files(path))
    columns = _columns_of(path) if path.suffix == ".csv" and path.is_file() else None
    return columns is not None and columns.view is not None


def find(places: Iterable[Path]) -> tuple[Path, ...]:
    """Return the timestamps in folders or in their subfolders ``timestamps``; equal copies only once.

    Args:
        places: Folders to search. Paths that are not folders are skipped.
    """
    unique: dict[Path, None] = {}
    for place in places:
        if not place.is_dir():
            continue
        tables = sorted(place.glob("*.csv"), key=lambda file: natural_key(file.name))
        folders = [place / inside for inside in ("timestamps", "synchronized_videos/timestamps", "videos/timestamps")]
        for path in (*(tables if len(tables) <= _MAX_FILES else ()), *folders):
            if matches(path):
                unique[path.resolve()] = None
    # FreeMoCap copies the timestamps of imported videos.
    contents = {path: tuple((file.name, file.read_bytes()) for file in _contents(path)) for path in unique}
    first = {content: path for path, content in reversed(contents.items())}
    return tuple(path for path, content in contents.items() if first[content] == path)


def _contents(path: Path) -> list[Path]:
    return _files(path) if path.is_dir() else [path]


def read_timestamps(path: Path) -> Timestamps:
    """Read the timestamps of all views.

    Raises:
        FileError: If the path does not exist, has no timestamps, contains something other than numbers, or repeats a
            frame.
    """
    must_exist(path, "timestamps")
    if path.is_dir():
        return _read_folder(path)
    columns = _columns_of(path)
    if columns is None or columns.view is None:
        raise FileError(
            f"{path} is not a table of timestamps: expected the columns camera, frame and time_s in the first line. "
            f"Other accepted names: {choices(_VIEWS)}; {choices(_FRAMES)}; {choices(_TIMES, 20)}."
        )
    rows: dict[str, list[tuple[int, float]]] = {}
    for view, frame, time_s in _rows(path, columns):
        rows.setdefault(view, []).append((frame, time_s))
    if not rows:
        raise FileError(f"{path} contains no times, only a header.")
    return Timestamps(path.name, {view: _view_times(path, view, each, columns) for view, each in rows.items()})


def _columns_of(file: Path) -> _Columns | None:
    """Return the required columns of a table, or None if its header is not that of a table of timestamps."""
    try:
        with file.open(newline="", encoding="utf-8-sig") as lines:
            header = next(csv.reader(iter([lines.readline(10_000)])), [])
    except (UnicodeDecodeError, OSError, csv.Error):
        return None
    names = [word.strip().lower() for word in header]
    times = [name for name in names if name in _TIMES]
    if len(times) != 1 or len(names) > _MAX_COLUMNS or any(re.match(r"(x|y|u|v)(_|$)|img_|obj_", n) for n in names):
        return None
    view, frame = (
        next((names.index(name) for name in accepted if name in names), None) for accepted in (_VIEWS, _FRAMES)
    )
    return _Columns(view, frame, names.index(times[0]), _TIMES[times[0]])


def _rows(file: Path, columns: _Columns) -> Iterable[tuple[str, int, float]]:
    """Yield the view, frame number (-1 without a frame column) and time in s of each row."""
    try:
        with file.open(newline="", encoding="utf-8-sig") as lines:
            rows = list(csv.reader(lines))[1:]
    except (UnicodeDecodeError, OSError, csv.Error) as error:
        raise FileError(f"{file} is not a CSV file in UTF-8: {error}.") from None
    for number, row in enumerate(rows, start=2):
        if not row:
            continue
        try:
            frame = -1.0 if columns.frame is None else float(row[columns.frame])
            time_s = columns.scale * float(row[columns.time])
            view = "" if columns.view is None else row[columns.view].strip()
        except (ValueError, IndexError):
            frame, time_s, view = math.nan, math.nan, ""
        if not (math.isfinite(time_s) and frame.is_integer() and abs(frame) < _MAX_FRAME):
            raise FileError(
                f"{file}, line {number}: expected an integer frame number and a time, got {','.join(row)[:80]!r}. "
                "Is the file truncated?"
            )
        yield view, int(frame), time_s


def _view_times(file: Path, view: str, rows: Sequence[tuple[int, float]], columns: _Columns) -> ViewTimes:
    times = np.array([time_s for _, time_s in rows])
    if columns.frame is None:
        return ViewTimes(None, times)
    numbers = np.array([frame for frame, _ in rows], dtype=np.int64)
    order = np.argsort(numbers, kind="stable")
    numbers = numbers[order]
    repeated = np.flatnonzero(np.diff(numbers) == 0)
    if len(repeated):
        raise FileError(
            f"{file} contains frame {numbers[repeated[0]]} of {view or file.stem} twice. Keep one time per frame."
        )
    return ViewTimes(numbers, times[order])


def _files(folder: Path) -> list[Path]:
    """Return the files with the times of one view each: arrays, or tables if there are no arrays."""
    entries = sorted(folder.iterdir(), key=lambda file: natural_key(file.name))[:_MAX_FILES]
    arrays = [file for file in entries if file.suffix == ".npy" and file.is_file()]
    tables = [file for file in entries if file.suffix == ".csv" and file.is_file()]
    return arrays or [file for file in tables if (c := _columns_of(file)) is not None and c.view is None]


def _read_folder(folder: Path) -> Timestamps:
    files = _files(folder)
    if not files:
        raise FileError(f"{folder} contains no timestamps: expected one .npy or .csv file per view.")
    by_view, array_units = {}, []
    for file in files:
        columns = _columns_of(file) if file.suffix == ".csv" else None
        name = _NAME_SUFFIX.sub("", file.stem)
        if columns is not None:
            rows = [(frame, time_s) for _, frame, time_s in _rows(file, columns)]
            by_view[name or file.stem] = _view_times(file, name, rows, columns)
            continue
        times, unit = _array(file)
        by_view[name or file.stem] = ViewTimes(None, times)
        array_units.append(unit)
    if len(by_view) < len(files):
        raise FileError(f"{folder} contains several files for one view: {choices(file.name for file in files)}.")
    units = sorted(set(array_units))
    return Timestamps(folder.name, by_view, (f"{folder.name}: times read as {choices(units)}.",) if units else ())


def _array(file: Path) -> tuple[np.ndarray, str]:
    """Return the times of a view in s, and the unit in which the file stores them."""
    with reading(file, "NumPy array file"):
        values = np.load(file, allow_pickle=False)
    if not isinstance(values, np.ndarray) or values.ndim != 1 or values.dtype.kind not in "fiu" or len(values) < 2:
        shape = getattr(values, "shape", None)
        raise FileError(f"{file}: expected one time per frame, an array of shape (frame,), got shape {shape}.")
    # In float64, nanoseconds since 1970 are rounded to a quarter of a microsecond.
    times = values.astype(np.float64)
    if not np.isfinite(times).all():
        raise FileError(f"{file} contains times that are not finite.")
    steps = np.diff(times)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    for unit, scale in (("seconds", 1.0), ("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9)):
        if _MIN_INTERVAL_S <= step * scale < 1.0:
            return times * scale, unit
    raise FileError(
        f"{file}: the interval {step:g} between frames is not plausible in any unit. Use a table with a time_s column."
    )
