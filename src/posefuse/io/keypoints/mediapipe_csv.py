"""MediaPipe's landmarks in CSV: wide, a row a frame; or long, a row a landmark. See ``mediapipe``."""

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from posefuse.errors import FileError
from posefuse.io.keypoints.people import whole_number
from posefuse.skeleton.skeletons import shipped_skeleton

_LONG = ("frame", "landmark", "x", "y")
_FRAMES = ("frame", "frame_index", "frame_id", "frame_number")
_KINDS = {"x": 0, "y": 1, "z": 2, "visibility": 3, "v": 3, "vis": 3}


@dataclass(frozen=True)
class Landmarks:
    """What one file holds, in its own unit of length.

    Attributes:
        recorded: shape (n,), int64: numbers of its frames.
        frame_of_row: shape (row,), int64, in order.
        values: shape (row, landmark, 4): x, y, z, visibility; NaN where missing.
        size_px: width and height of the image, where it says.
        rate_hz: where it says.
        time_s: shape (n,): of each frame, where it says.
    """

    recorded: np.ndarray
    frame_of_row: np.ndarray
    values: np.ndarray
    size_px: tuple[int, int] | None = None
    rate_hz: float | None = None
    time_s: np.ndarray | None = None


def matches(file: Path) -> bool:
    """Whether a CSV file is one."""
    with file.open(encoding="utf-8-sig", errors="replace", newline="") as lines:
        header = [word.strip().lower() for word in lines.readline(100_000).split(",")]
    return set(_LONG) <= set(header) or len(_wide(header)) > 2 * 33 - 1


def _body() -> tuple[str, ...]:
    return shipped_skeleton("mediapipe_33").keypoints


def _wide(header: list[str]) -> dict[int, tuple[int, int]]:
    """Column to landmark and number of it, of a row a frame."""
    names = {name: i for i, name in enumerate(_body())}
    found, numbered = {}, {}
    for column, word in enumerate(header):
        named = re.fullmatch(r"(.+)_(x|y|z|visibility|v|vis)", word)
        if named and named.group(1) in names:
            found[column] = names[named.group(1)], _KINDS[named.group(2)]
        elif match := re.fullmatch(r"(x|y|z|v)_?(\d{1,3})", word):
            numbered[column] = int(match.group(2)), _KINDS[match.group(1)]
    if not found and numbered:
        first = min(landmark for landmark, _ in numbered.values())
        shifted = {column: (landmark - first, kind) for column, (landmark, kind) in numbered.items()}
        found = shifted if {k for k, _ in shifted.values()} == set(range(len(names))) else {}
    return found


def read(file: Path) -> Landmarks:
    """Read a file.

    Raises:
        FileError: if it is cut short, or a cell holds no number.
    """
    try:
        with file.open(encoding="utf-8-sig", newline="") as lines:
            header, *rows = [row for row in csv.reader(lines) if row] or [[""]]
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{file} is not a CSV file in UTF-8: {error}.") from None
    header = [word.strip().lower() for word in header]
    if not rows:
        raise FileError(f"{file} holds no frames. Is the file truncated?")
    for number, row in enumerate(rows, start=2):
        if len(row) != len(header):
            raise FileError(
                f"{file}, line {number}: {len(row)} columns, expected {len(header)}. Is the file truncated?"
            )
    return _long_rows(file, header, rows) if set(_LONG) <= set(header) else _wide_rows(file, header, rows)


def _cell(file: Path, line: int, text: str) -> float:
    try:
        return float(text) if text.strip() else np.nan
    except ValueError:
        raise FileError(f"{file}, line {line}: {text[:40]!r} is no number.") from None


def _wide_rows(file: Path, header: list[str], rows: list[list[str]]) -> Landmarks:
    columns = _wide(header)
    place = next((header.index(name) for name in _FRAMES if name in header), None)
    frames = np.arange(len(rows))
    values = np.full((len(rows), len(_body()), 4), np.nan)
    for i, row in enumerate(rows):
        if place is not None:
            frames[i] = whole_number(_cell(file, i + 2, row[place]), "the frame", f"{file}, line {i + 2}")
        for column, (landmark, kind) in columns.items():
            values[i, landmark, kind] = _cell(file, i + 2, row[column])
    if len(np.unique(frames)) < len(frames):
        raise FileError(f"{file} has a frame twice.")
    order = np.argsort(frames, kind="stable")
    frames, values = frames[order], values[order]
    seen = np.isfinite(values[..., :2]).all(axis=-1).any(axis=-1)
    return Landmarks(frames, frames[seen], values[seen])


def _long_rows(file: Path, header: list[str], rows: list[list[str]]) -> Landmarks:
    names = {name: i for i, name in enumerate(_body())}
    place = {name: header.index(name) for name in (*_LONG, *(n for n in ("z", "visibility") if n in header))}
    found: dict[int, np.ndarray] = {}
    for line, row in enumerate(rows, start=2):
        where = f"{file}, line {line}"
        frame = whole_number(_cell(file, line, row[place["frame"]]), "the frame", where)
        person = found.setdefault(frame, np.full((len(names), 4), np.nan))
        said = row[place["landmark"]].strip().lower()
        if not said:
            continue
        k = names[said] if said in names else whole_number(_cell(file, line, said), "the landmark", where)
        if not 0 <= k < len(names):
            raise FileError(f"{where}: landmark {k}; MediaPipe's body has 0 to {len(names) - 1}.")
        if np.isfinite(person[k]).any():
            raise FileError(f"{where}: landmark {said} of frame {frame} is there twice.")
        person[k] = [_cell(file, line, row[place[n]]) if n in place else np.nan for n in ("x", "y", "z", "visibility")]
    frames = np.array(sorted(found), dtype=np.int64)
    values = np.array([found[frame] for frame in frames.tolist()]).reshape(len(frames), len(names), 4)
    seen = np.isfinite(values[..., :2]).all(axis=-1).any(axis=-1)
    return Landmarks(frames, frames[seen], values[seen])
