"""DeepLabCut's 3D tables, h5 (pandas, ``df_with_missing``) or CSV: columns x, y, z per body part, one row per frame.

Header rows: scorer (``posefuse_<layer>``), individuals (only if there are several), bodyparts, coords. Lengths are in
meters. The index is the frame number; missing frame numbers are rows without points. The h5 file also has the group
``posefuse``, see :mod:`posefuse.io.results.hdf5`; the CSV contains only the points.
"""

import csv as text_csv
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import h5py
import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import must_exist, reading, replacing
from posefuse.io.hdf5 import open_hdf5
from posefuse.io.pandas_tables import Frame, read_frame, write_frame
from posefuse.io.results import hdf5, tables
from posefuse.io.results.format import ResultFacts, ResultFormat
from posefuse.io.results.rows import blocks, rows_of
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import LAYERS, Reconstruction
from posefuse.model.stored_points import StoredPoints

KEY = "df_with_missing"
_ONE = ("scorer", "bodyparts", "coords")
_MANY = ("scorer", "individuals", "bodyparts", "coords")
_SCORER = "posefuse_"


def write(result: Reconstruction, path: Path, layer: LayerName) -> None:
    """Write one layer of all people, as CSV if the path ends in .csv.

    Raises:
        ResultError: if there are no frames, or nearly all rows would be empty.
    """
    row_indices, n_rows = rows_of(result, "deeplabcut")
    levels, columns = _columns(result, layer)
    index = result.frame_numbers[0] + np.arange(n_rows)
    rows = (block.reshape(len(block), -1) for block in blocks(result.layers[layer].points_m, row_indices))
    with replacing(path) as temporary:
        if path.suffix.lower() == ".csv":
            _write_csv(temporary, levels, columns, index, rows)
        else:
            with h5py.File(temporary, "w") as file:
                write_frame(file, KEY, levels, columns, index, rows)
                hdf5.write_group(file, result, layer)


def _columns(result: Reconstruction, layer: LayerName) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the names of the levels, and the names of each column at all levels."""
    scorer, keypoints = f"{_SCORER}{layer}", result.skeleton.keypoints
    if len(result.person_ids) == 1:
        return _ONE, [(scorer, part, axis) for part in keypoints for axis in "xyz"]
    people = result.person_ids
    return _MANY, [(scorer, person, part, axis) for person in people for part in keypoints for axis in "xyz"]


def _write_csv(
    path: Path, levels: tuple[str, ...], columns: list[tuple[str, ...]], index: np.ndarray, rows: Iterator[np.ndarray]
) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        lines = text_csv.writer(file, lineterminator="\n")
        for i, level in enumerate(levels):
            lines.writerow([level, *(column[i] for column in columns)])
        numbers = iter(index.tolist())
        for values in rows:
            for row in values.tolist():
                lines.writerow([next(numbers), *("" if value != value else repr(value) for value in row)])


def matches(path: Path) -> bool:
    """Return whether a file contains 3D points of DeepLabCut rather than 2D predictions."""
    try:
        if path.suffix.lower() == ".csv":
            return _is_3d(_header_of(path)[1])
        with h5py.File(path) as file:
            return KEY in file and _is_3d(read_frame(file[KEY]).columns)  # type: ignore[arg-type]
    except (OSError, KeyError, ValueError, RuntimeError, FileError):
        return False


def _is_3d(columns: list[tuple[str, ...]]) -> bool:
    return bool(columns) and {column[-1] for column in columns} == set("xyz")


def read(path: Path) -> StoredPoints:
    """Read a file of DeepLabCut or posefuse. A single individual without a name is named after the file.

    Raises:
        FileError: if it is not such a file, or is truncated.
    """
    must_exist(path, "3D table of DeepLabCut")
    if path.suffix.lower() == ".csv":
        with reading(path, "CSV file"):
            return _points(path, _read_csv(path))
    with open_hdf5(path, "HDF5 table of DeepLabCut") as file:
        frame = read_frame(file[KEY])  # type: ignore[arg-type]
        points = _points(path, frame)
        return hdf5.read_group(file, path, points.points_m) if hdf5.GROUP in file else points


def _points(path: Path, frame: Frame) -> StoredPoints:
    names = [column[-3:] if len(column) == len(_MANY) else ("", *column[-2:]) for column in frame.columns]
    people = tuple(dict.fromkeys(person for person, _, _ in names))
    parts = tuple(dict.fromkeys(part for _, part, _ in names))
    expected = [(person, part, axis) for person in people for part in parts for axis in "xyz"]
    position = {column: i for i, column in enumerate(names)}
    if sorted(position) != sorted(expected) or len(names) != len(expected) or frame.values.shape[1] != len(names):
        raise FileError(
            f"{path}: expected each of the columns x, y and z exactly once for every body part (and individual)."
        )
    points = frame.values[:, [position[column] for column in expected]].reshape(-1, len(people), len(parts), 3)
    scorer = frame.columns[0][0]
    layer = next((name for name in LAYERS if scorer == f"{_SCORER}{name}"), "")
    return StoredPoints(
        keypoints=parts,
        person_ids=people if len(frame.columns[0]) == len(_MANY) else (path.stem,),
        frame_numbers=tables.increasing(np.asarray(frame.index), path),
        time_s=np.full(len(points), np.nan),
        points_m=points,
        layer=layer,
    )


def _header_of(path: Path) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(islice(text_csv.reader(file), len(_MANY)))
    levels = next(
        (levels for levels in (_ONE, _MANY) if tuple(row[0] for row in rows if row)[: len(levels)] == levels), ()
    )
    if not levels:
        raise FileError(f"{path} is not a DeepLabCut table: its first rows must be {' '.join(_ONE)}.")
    names = [row[1:] for row in rows[: len(levels)]]
    return levels, list(zip(*names, strict=True))


def _read_csv(path: Path) -> Frame:
    levels, columns = _header_of(path)
    index, values = [], []
    with path.open(newline="", encoding="utf-8") as file:
        lines = text_csv.reader(file)
        for number, row in enumerate(lines, 1):
            if number <= len(levels):
                continue
            if len(row) != len(columns) + 1:
                raise FileError(
                    f"{path}, row {number}: expected {len(columns) + 1} columns, got {len(row)}. Is it truncated?"
                )
            index.append(int(row[0]))
            values.append([float(cell or "nan") for cell in row[1:]])
    return Frame(columns, np.array(index, dtype=np.int64), np.array(values).reshape(len(index), len(columns)))


def _require(facts: ResultFacts) -> None:
    rows_of(facts, "deeplabcut")


FORMAT = ResultFormat(
    name="deeplabcut",
    files="*.h5 or *.csv in 3D, all people in one",
    conventions="meters, world axes; x y z per body part; one row per frame; pandas' df_with_missing",
    lacks="times, status, errors, covariances, views in CSV",
    complete_endings=(".h5",),
    require=_require,
    additional_name="points_dlc.h5",
    endings=(".csv", ".h5"),
    name_words=("dlc", "deeplabcut"),
    matches=matches,
    read=read,
    write_layer=write,
)
