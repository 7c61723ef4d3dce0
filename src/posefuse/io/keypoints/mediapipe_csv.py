"""MediaPipe landmarks in CSV: wide with one row per frame, or long with one row per landmark. See ``mediapipe``."""

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from posefuse.errors import FileError
from posefuse.io.keypoints.people import integer_from_float
from posefuse.skeleton.skeletons import shipped_skeleton

_LONG = ("frame", "landmark", "x", "y")
_FRAMES = ("frame", "frame_index", "frame_id", "frame_number")
_KINDS = {"x": 0, "y": 1, "z": 2, "visibility": 3, "v": 3, "vis": 3}


@dataclass(frozen=True)
class Landmarks:
    """The content of one file, in its own unit of length.

    Attributes:
        recorded: Shape (n,), int64: numbers of the recorded frames.
        frame_of_row: Shape (row,), int64: frame number of each row (one person in one frame), ascending.
        values: Shape (row, landmark, 4): x, y, z, visibility, NaN where missing.
        size_px: Width and height of the image, or None if not stated.
        rate_hz: Frame rate, or None if not stated.
        time_s: Shape (n,): times of the frames, or None if not stated.
    """

    recorded: np.ndarray
    frame_of_row: np.ndarray
    values: np.ndarray
    size_px: tuple[int, int] | None = None
    rate_hz: float | None = None
    time_s: np.ndarray | None = None


def matches(file: Path) -> bool:
    """Return whether a CSV file is in this format."""
    with file.open(encoding="utf-8-sig", errors="replace", newline="") as lines:
        header = [word.strip().lower() for word in lines.readline(100_000).split(",")]
    return set(_LONG) <= set(header) or len(_wide(header)) > 2 * 33 - 1


def _body() -> tuple[str, ...]:
    return shipped_skeleton("mediapipe_33").keypoints


def _wide(header: list[str]) -> dict[int, tuple[int, int]]:
    """Return landmark and coordinate index by column, for files with one row per frame."""
    names = {name: i for i, name in enumerate(_body())}
    columns, numbered = {}, {}
    for column, word in enumerate(header):
        named = re.fullmatch(r"(.+)_(x|y|z|visibility|v|vis)", word)
        if named and named.group(1) in names:
            columns[column] = names[named.group(1)], _KINDS[named.group(2)]
        elif match := re.fullmatch(r"(x|y|z|v)_?(\d{1,3})", word):
            numbered[column] = int(match.group(2)), _KINDS[match.group(1)]
    if not columns and numbered:
        first = min(landmark for landmark, _ in numbered.values())
        shifted = {column: (landmark - first, kind) for column, (landmark, kind) in numbered.items()}
        columns = shifted if {k for k, _ in shifted.values()} == set(range(len(names))) else {}
    return columns


def read(file: Path) -> Landmarks:
    """Read a file.

    Raises:
        FileError: If the file is truncated, or a cell is not a number.
    """
    try:
        with file.open(encoding="utf-8-sig", newline="") as lines:
            header, *rows = [row for row in csv.reader(lines) if row] or [[""]]
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{file} is not a CSV file in UTF-8: {error}.") from None
    header = [word.strip().lower() for word in header]
    if not rows:
        raise FileError(f"{file} contains no frames. Is the file truncated?")
    for number, row in enumerate(rows, start=2):
        if len(row) != len(header):
            raise FileError(
                f"{file}, line {number}: expected {len(header)} columns, got {len(row)}. Is the file truncated?"
            )
    return _long_rows(file, header, rows) if set(_LONG) <= set(header) else _wide_rows(file, header, rows)


def _cell(file: Path, line: int, text: str) -> float:
    try:
        return float(text) if text.strip() else np.nan
    except ValueError:
        raise FileError(f"{file}, line {line}: {text[:40]!r} is not a number.") from None


def _wide_rows(file: Path, header: list[str], rows: list[list[str]]) -> Landmarks:
    columns = _wide(header)
    frame_column = next((header.index(name) for name in _FRAMES if name in header), None)
    frames = np.arange(len(rows))
    values = np.full((len(rows), len(_body()), 4), np.nan)
    for i, row in enumerate(rows):
        if frame_column is not None:
            value = _cell(file, i + 2, row[frame_column])
            frames[i] = integer_from_float(value, "the frame", f"{file}, line {i + 2}")
        for column, (landmark, kind) in columns.items():
            values[i, landmark, kind] = _cell(file, i + 2, row[column])
    if len(np.unique(frames)) < len(frames):
        raise FileError(f"{file} contains the same frame twice.")
    order = np.argsort(frames, kind="stable")
    frames, values = frames[order], values[order]
    detected = np.isfinite(values[..., :2]).all(axis=-1).any(axis=-1)
    return Landmarks(frames, frames[detected], values[detected])


def _long_rows(file: Path, header: list[str], rows: list[list[str]]) -> Landmarks:
    names = {name: i for i, name in enumerate(_body())}
    columns = {name: header.index(name) for name in (*_LONG, *(n for n in ("z", "visibility") if n in header))}
    by_frame: dict[int, np.ndarray] = {}
    for line, row in enumerate(rows, start=2):
        where = f"{file}, line {line}"
        frame = integer_from_float(_cell(file, line, row[columns["frame"]]), "the frame", where)
        person = by_frame.setdefault(frame, np.full((len(names), 4), np.nan))
        name = row[columns["landmark"]].strip().lower()
        if not name:
            continue
        k = names[name] if name in names else integer_from_float(_cell(file, line, name), "the landmark", where)
        if not 0 <= k < len(names):
            raise FileError(f"{where}: expected a landmark of MediaPipe's body, 0 to {len(names) - 1}, got {k}.")
        if np.isfinite(person[k]).any():
            raise FileError(f"{where}: landmark {name} of frame {frame} occurs twice.")
        person[k] = [
            _cell(file, line, row[columns[n]]) if n in columns else np.nan for n in ("x", "y", "z", "visibility")
        ]
    frames = np.array(sorted(by_frame), dtype=np.int64)
    values = np.array([by_frame[frame] for frame in frames.tolist()]).reshape(len(frames), len(names), 4)
    detected = np.isfinite(values[..., :2]).all(axis=-1).any(axis=-1)
    return Landmarks(frames, frames[detected], values[detected])
