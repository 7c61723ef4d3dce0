"""When each view took its frames: a table of all views, or a folder of a file a view.

Tables (``.csv``) have a column of the view (``camera``, ``view``, ``port``, ...), one of the frame's number
(``frame``, ``frame_index``, ``sync_index``, ...), and one of the time: ``time_s``, ``frame_time``, ``timestamp`` in
seconds, or with ``_ms``, ``_us``, ``_ns``. Without a column of frames, rows are a view's frames in order. Caliscope's
``frame_time_history.csv`` is such a table.

A folder (FreeMoCap's ``timestamps``) holds a ``.npy`` of times a view, a number a frame, or such a table without the
column of the view; files are named after views. Arrays do not say their unit: between frames lie milliseconds to a
second, and that tells.
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
_MOST_COLUMNS = 8
_MOST_FILES = 300
_LEAST_STEP_S = 1e-3
_LARGEST_FRAME = 2**40


@dataclass(frozen=True, eq=False)
class ViewTimes:
    """When a view took its frames.

    Attributes:
        frames: shape (n,), int64: their numbers, ascending, or None where they are the view's frames in order.
        time_s: shape (n,).
    """

    frames: np.ndarray | None
    time_s: np.ndarray


@dataclass(frozen=True, eq=False)
class Timestamps:
    """The times of all views, as a file or folder has them.

    Attributes:
        source: its name, for messages.
        of_view: by the view's name there.
        notes: what is worth saying.
    """

    source: str
    of_view: dict[str, ViewTimes]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Columns:
    view: int | None
    frame: int | None
    time: int
    scale: float


def matches(path: Path) -> bool:
    """Whether a file is such a table of several views, or a folder holds a file of times a view."""
    if path.is_dir():
        return "timestamp" in path.name.lower() and bool(_files(path))
    columns = _columns_of(path) if path.suffix == ".csv" and path.is_file() else None
    return columns is not None and columns.view is not None


def find(places: Iterable[Path]) -> tuple[Path, ...]:
    """The timestamps in folders, or in a folder ``timestamps`` in them."""
    found: dict[Path, None] = {}
    for place in places:
        if not place.is_dir():
            continue
        tables = sorted(place.glob("*.csv"), key=lambda file: natural_key(file.name))
        folders = [place / inside for inside in ("timestamps", "synchronized_videos/timestamps", "videos/timestamps")]
        for path in (*(tables if len(tables) <= _MOST_FILES else ()), *folders):
            if matches(path):
                found[path.resolve()] = None
    return tuple(found)


def read_timestamps(path: Path) -> Timestamps:
    """Read the times of all views.

    Raises:
        FileError: if there is nothing there, or it holds other than numbers, or a frame twice.
    """
    must_exist(path, "timestamps")
    if path.is_dir():
        return _read_folder(path)
    columns = _columns_of(path)
    if columns is None or columns.view is None:
        raise FileError(
            f"{path} is no table of timestamps: expected the columns camera, frame, time_s in its first line (or "
            f"{choices(_VIEWS)}; {choices(_FRAMES)}; {choices(_TIMES, 20)})."
        )
    rows: dict[str, list[tuple[int, float]]] = {}
    for view, frame, time_s in _rows(path, columns):
        rows.setdefault(view, []).append((frame, time_s))
    if not rows:
        raise FileError(f"{path} holds no times: it ends in its header.")
    return Timestamps(path.name, {view: _view_times(path, view, each, columns) for view, each in rows.items()})


def _columns_of(file: Path) -> _Columns | None:
    """Where a table has what it needs; None where the first line names no time, or is of something else."""
    try:
        with file.open(newline="", encoding="utf-8-sig") as lines:
            header = next(csv.reader(iter([lines.readline(10_000)])), [])
    except (UnicodeDecodeError, OSError, csv.Error):
        return None
    names = [word.strip().lower() for word in header]
    times = [name for name in names if name in _TIMES]
    if len(times) != 1 or len(names) > _MOST_COLUMNS or any(re.match(r"(x|y|u|v)(_|$)|img_|obj_", n) for n in names):
        return None
    view, frame = (next((names.index(name) for name in known if name in names), None) for known in (_VIEWS, _FRAMES))
    return _Columns(view, frame, names.index(times[0]), _TIMES[times[0]])


def _rows(file: Path, columns: _Columns) -> Iterable[tuple[str, int, float]]:
    """View, frame (-1 without) and time of each line."""
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
        if not (math.isfinite(time_s) and frame.is_integer() and abs(frame) < _LARGEST_FRAME):
            raise FileError(
                f"{file}, line {number}: expected a whole frame number and a time, got {','.join(row)[:80]!r}. "
                "Was it cut short?"
            )
        yield view, int(frame), time_s


def _view_times(file: Path, view: str, rows: Sequence[tuple[int, float]], columns: _Columns) -> ViewTimes:
    times = np.array([time_s for _, time_s in rows])
    if columns.frame is None:
        return ViewTimes(None, times)
    numbers = np.array([frame for frame, _ in rows], dtype=np.int64)
    order = np.argsort(numbers, kind="stable")
    numbers = numbers[order]
    twice = np.flatnonzero(np.diff(numbers) == 0)
    if len(twice):
        raise FileError(f"{file} has frame {numbers[twice[0]]} of {view or file.stem} twice. Keep one time a frame.")
    return ViewTimes(numbers, times[order])


def _files(folder: Path) -> list[Path]:
    """A file of times a view: arrays, or, where there are none, tables."""
    found = sorted(folder.iterdir(), key=lambda file: natural_key(file.name))[:_MOST_FILES]
    arrays = [file for file in found if file.suffix == ".npy" and file.is_file()]
    tables = [file for file in found if file.suffix == ".csv" and file.is_file()]
    return arrays or [file for file in tables if (c := _columns_of(file)) is not None and c.view is None]


def _read_folder(folder: Path) -> Timestamps:
    files = _files(folder)
    if not files:
        raise FileError(f"{folder} holds no file of times a view, .npy or .csv.")
    of_view, notes = {}, []
    for file in files:
        columns = _columns_of(file) if file.suffix == ".csv" else None
        name = re.sub(r"[_\-. ]*(unix)?[_\-. ]*time[_\-]?stamps?.*$", "", file.stem, flags=re.IGNORECASE)
        if columns is not None:
            rows = [(frame, time_s) for _, frame, time_s in _rows(file, columns)]
            of_view[name or file.stem] = _view_times(file, name, rows, columns)
            continue
        times, unit = _array(file)
        of_view[name or file.stem] = ViewTimes(None, times)
        notes.append(unit)
    if len(of_view) < len(files):
        raise FileError(f"{folder} holds several files of times of one view: {choices(file.name for file in files)}.")
    units = sorted(set(notes))
    return Timestamps(folder.name, of_view, (f"{folder.name}: times read as {choices(units)}.",) if units else ())


def _array(file: Path) -> tuple[np.ndarray, str]:
    """A view's times in seconds, and the unit they were in."""
    with reading(file, "NumPy array file"):
        values = np.load(file, allow_pickle=False)
    if not isinstance(values, np.ndarray) or values.ndim != 1 or values.dtype.kind not in "fiu" or len(values) < 2:
        shape = getattr(values, "shape", None)
        raise FileError(f"{file}: expected a view's times, numbers of shape (frame,), got shape {shape}.")
    # Nanoseconds since 1970 lose a quarter of a microsecond as floats.
    times = values.astype(np.float64)
    if not np.isfinite(times).all():
        raise FileError(f"{file} holds times that are no numbers.")
    step = float(np.median(np.diff(times)))
    for unit, scale in (("seconds", 1.0), ("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9)):
        if _LEAST_STEP_S <= step * scale < 1.0:
            return times * scale, unit
    raise FileError(
        f"{file}: {step:g} between frames is no camera's interval in any unit. Give a table with a column time_s."
    )
