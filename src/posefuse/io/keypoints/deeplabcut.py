"""DeepLabCut's predictions of one animal as CSV: a file a camera, columns x, y, likelihood a body part.

Three header rows: scorer, bodyparts, coords. Pixels; a body part that is not there is empty. The files do not say a
frame rate, nor which camera they are of: views are named by what differs between the files' names.
"""

import csv
from itertools import islice
from pathlib import Path

import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import natural_key
from posefuse.io.keypoints.columns import ViewColumns, assemble
from posefuse.io.keypoints.names import skeleton_of, view_names
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections

_COORDINATES = ("x", "y", "likelihood")
_HEADER = ["scorer", "bodyparts", "coords"]


def matches(path: Path) -> bool:
    """Whether a file is one, or a folder holds one."""
    return any(_header(file) == _HEADER for file in files_of(path))


def files_of(path: Path) -> list[Path]:
    """The files, in the order of their names; also those that end in their header, for a camera must not go missing."""
    found = sorted(path.glob("*.csv"), key=lambda file: natural_key(file.name)) if path.is_dir() else [path]
    files = [file for file in found if file.suffix == ".csv" and file.is_file()]
    return [file for file in files if _header(file) == _HEADER[: len(_header(file))]]


def _header(file: Path) -> list[str]:
    """The first words of the first three lines that there are."""
    with file.open(encoding="utf-8", errors="replace") as lines:
        return [line.split(",")[0].strip() for line in islice(lines, len(_HEADER))]


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: if a file is cut short, or the cameras have different body parts.
    """
    files = files_of(path)
    parts, views = None, []
    for file, name in zip(files, view_names(files), strict=True):
        found, numbers, values = _read_view(file)
        if parts is not None and found != parts:
            raise FileError(f"{file} has other body parts than {files[0].name}; one recording has one skeleton.")
        parts = found
        rows = np.flatnonzero(np.isfinite(values).any(axis=(1, 2)))
        views.append(ViewColumns(name, numbers, numbers[rows], values[rows], np.zeros(len(rows), dtype=np.int64)))
    assert parts is not None
    skeleton = request.skeleton or skeleton_of("deeplabcut", parts)
    if len(skeleton) != len(parts):
        raise FileError(f"{path} has {len(parts)} body parts, skeleton {skeleton.name} has {len(skeleton)} keypoints.")
    return assemble(path, views, skeleton, request.rate_hz)


def _read_view(file: Path) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Body parts, frame numbers, and values (frame, part, 3)."""
    with file.open(newline="", encoding="utf-8") as lines:
        table = list(csv.reader(lines))
    if len(table) <= len(_HEADER):
        raise FileError(f"{file} holds no frames: {len(table)} lines, of which three are the header. Was it cut short?")
    names, kinds = table[1][1:], table[2][1:]
    if tuple(kinds) != _COORDINATES * (len(kinds) // 3) or names[0::3] != names[2::3]:
        raise FileError(f"{file}: expected the columns x, y, likelihood for each body part, as DeepLabCut writes them.")
    for place, row in enumerate(table[3:], start=4):
        if len(row) != len(names) + 1:
            raise FileError(f"{file}, line {place}: {len(row)} columns, expected {len(names) + 1}. Was it cut short?")
    try:
        numbers = np.array([int(float(row[0])) for row in table[3:]], dtype=np.int64)
        values = np.array([[float(cell or "nan") for cell in row[1:]] for row in table[3:]])
    except ValueError as error:
        raise FileError(f"{file} holds something that is not a number: {error}.") from None
    values = values.reshape(len(numbers), len(names) // 3, 3)
    values[np.isnan(values[..., :2]).any(axis=-1)] = np.nan
    return names[0::3], numbers, values
