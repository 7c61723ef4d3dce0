"""DeepLabCut predictions in CSV or h5: one file per camera, x, y, likelihood per body part, one animal or several.

Header rows are scorer, (individuals,) bodyparts, coords. Positions are in pixels; a missing body part is empty.
Lightning Pose and EKS write further columns per body part: variances are the noise of the detections (``sigma_px``, the
root of the mean over x and y), posterior variances before those between the networks of an ensemble; medians are
ignored with a note. The files state neither frame rate nor camera: views are named by the part in which the file names
differ.

The h5 files have pandas' ``table`` layout (DeepLabCut) or ``fixed`` layout (movement and others). In ``table`` files
the column names are pickled; only strings, numbers and tuples are unpickled.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.files import files_at
from posefuse.io.hdf5 import open_hdf5
from posefuse.io.keypoints.camera_files import is_damaged
from posefuse.io.keypoints.columns import ViewColumns, assemble
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.names import view_names
from posefuse.io.keypoints.people import last_number
from posefuse.io.keypoints.request import Request
from posefuse.io.pandas_tables import Frame, read_frame
from posefuse.io.pickles import load_plain
from posefuse.model.detections import Detections
from posefuse.skeleton.from_names import skeleton_of

_COORDINATES = ("x", "y", "likelihood")
_VARIANCES = (("x_posterior_var", "y_posterior_var"), ("x_ens_var", "y_ens_var"))
_HEADER = ["scorer", "bodyparts", "coords"]
_MULTI_ANIMAL_HEADER = ["scorer", "individuals", "bodyparts", "coords"]
_MAX_COORDINATES = 100
_H5_KEYS = ("df_with_missing", "tracks", "keypoints")


@dataclass(frozen=True)
class _Table:
    """The content of one file.

    Attributes:
        columns: Individual, body part and coordinate of each column.
        numbers: Shape (frame,), int64: frame numbers.
        values: Shape (frame, column), NaN where empty.
    """

    columns: list[tuple[str, str, str]]
    numbers: np.ndarray
    values: np.ndarray


def matches(path: Path) -> bool:
    """Return whether a path is a file in this format or a folder that contains one."""
    files = files_of(path)
    return any(
        bool(_h5_table(file)) if file.suffix == ".h5" else _header(file) in (_HEADER, _MULTI_ANIMAL_HEADER)
        for file in files
    )


def files_of(path: Path) -> list[Path]:
    """Return the CSV files, or else the h5 files, in natural order.

    Files that end in their header are included, because a camera must not be dropped silently.
    """
    files = [file for file in files_at(path) if not file.name.startswith(".")]
    csv_files = [file for file in files if file.suffix == ".csv" and (_has_csv_header(file) or is_damaged(file))]
    if any(_has_csv_header(file) for file in csv_files):
        return csv_files
    h5_files = [file for file in files if file.suffix == ".h5" and (_h5_table(file) or is_damaged(file))]
    return h5_files if any(map(_h5_table, h5_files)) else []


def _has_csv_header(file: Path) -> bool:
    header = _header(file)
    return header[:3] == _HEADER[: len(header)] or header == _MULTI_ANIMAL_HEADER[: len(header)]


def _header(file: Path) -> list[str]:
    """Return the first words of the header lines: three, or four with individuals."""
    with file.open(encoding="utf-8", errors="replace") as lines:
        words = [line.split(",")[0].strip() for line in islice(lines, len(_MULTI_ANIMAL_HEADER))]
    return words if words[1:2] == ["individuals"] else words[: len(_HEADER)]


def _h5_table(file: Path) -> str | None:
    """Return the key of the predictions in an h5 file, or None if there are none."""
    try:
        with h5py.File(file) as content:
            return next((key for key in _H5_KEYS if f"{key}/table" in content or _is_fixed(content, key)), None)
    except Exception:  # a broken file can raise any exception
        return None


def _is_fixed(content: h5py.File, key: str) -> bool:
    """Return whether a key is a table of 2D predictions in pandas' fixed layout, with likelihood as a coordinate."""
    levels = [content.get(f"{key}/block0_items_level{i}") for i in (2, 3)]
    small = [level for level in levels if isinstance(level, h5py.Dataset) and (level.size or 0) <= _MAX_COORDINATES]
    return any(b"likelihood" in np.asarray(level).ravel().tolist() for level in small)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: If a file is truncated, or the cameras have different body parts.
    """
    files = files_of(path)
    parts, views, unused = None, [], set()
    for file, name in zip(files, view_names(files), strict=True):
        table = _read_h5(file) if file.suffix == ".h5" else _read_csv(file)
        file_parts, individuals = _parts(file, table)
        if parts is not None and file_parts != parts:
            raise FileError(
                f"{file} and {files[0].name} have different body parts. All files must have the same skeleton."
            )
        parts = file_parts
        variances = _variances(table)
        unused |= {kind for *_, kind in table.columns if kind not in (*_COORDINATES, *variances)}
        views.append(_view(name, table, parts, individuals, variances))
    assert parts is not None
    skeleton = request.skeleton or skeleton_of("deeplabcut", parts)
    if len(skeleton) != len(parts):
        raise FileError(
            f"{path} has {len(parts)} body parts, but skeleton {skeleton.name} has {len(skeleton)} keypoints."
        )
    notes = (f"{path.name}: other columns of each body part are not used: {choices(sorted(unused))}.",)
    return assemble(path, views, skeleton, request.rate_hz, notes if unused else ())


def _parts(file: Path, table: _Table) -> tuple[list[str], list[str]]:
    """Return body parts and individuals in the order of the file.

    Some individuals may have other body parts (``single``, with parts of the scene).
    """
    parts = list(dict.fromkeys(part for _, part, _ in table.columns))
    individuals = list(dict.fromkeys(individual for individual, _, _ in table.columns))
    kinds = {kind for *_, kind in table.columns}
    if not set(_COORDINATES) <= kinds or len(set(table.columns)) != len(table.columns):
        raise FileError(f"{file}: expected the columns x, y, likelihood for each body part.")
    return parts, individuals


def _variances(table: _Table) -> tuple[str, ...]:
    """Return the names of the columns with variances of x and y, or none."""
    kinds = {kind for *_, kind in table.columns}
    return next((pair for pair in _VARIANCES if set(pair) <= kinds), ())


def _view(
    name: str, table: _Table, parts: Sequence[str], individuals: Sequence[str], variances: tuple[str, ...]
) -> ViewColumns:
    """Return one row per frame and detected individual. The index of the individual is its track."""
    columns = {column: i for i, column in enumerate(table.columns)}
    kinds = (*_COORDINATES, *variances)
    values = np.full((len(table.numbers), len(individuals), len(parts), len(kinds)), np.nan)
    for i, individual in enumerate(individuals):
        for p, part in enumerate(parts):
            for c, kind in enumerate(kinds):
                column = columns.get((individual, part, kind))
                if column is not None:
                    values[:, i, p, c] = table.values[:, column]
    values[np.isnan(values[..., :2]).any(axis=-1)] = np.nan
    frame, individual = np.nonzero(np.isfinite(values).any(axis=(2, 3)))
    rows = values[frame, individual]
    return ViewColumns(
        name,
        table.numbers,
        table.numbers[frame],
        rows[..., :3],
        individual.astype(np.int64),
        sigma_px=_deviations(rows[..., 3:]) if variances else None,
    )


def _deviations(variances_px2: np.ndarray) -> np.ndarray:
    """Return standard deviations in px, shape (row, keypoint), NaN for invalid variances.

    Args:
        variances_px2: Shape (row, keypoint, 2): variances of x and y.
    """
    mean = variances_px2.mean(axis=-1)
    return np.sqrt(np.where(np.isfinite(mean) & (mean > 0.0), mean, np.nan))


def _read_csv(file: Path) -> _Table:
    try:
        with file.open(newline="", encoding="utf-8") as lines:
            rows = list(csv.reader(lines))
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{file} is not a CSV file in UTF-8: {error}.") from None
    header = len(_header(file))
    expected = _MULTI_ANIMAL_HEADER if header == len(_MULTI_ANIMAL_HEADER) else _HEADER
    if [row[0].strip() if row else "" for row in rows[:header]] != expected or len(rows) <= header:
        raise FileError(f"{file} contains no frames, only a header. Is the file truncated?")
    named = [row[1:] for row in rows[1:header]]
    width = len(named[0])
    for line, row in enumerate(rows[1:], start=2):
        if len(row) != width + 1:
            raise FileError(
                f"{file}, line {line}: expected {width + 1} columns, got {len(row)}. Is the file truncated?"
            )
    individuals = named[0] if header == len(_MULTI_ANIMAL_HEADER) else [""] * width
    columns = list(zip(individuals, named[-2], named[-1], strict=True))
    try:
        numbers = np.array([_number(row[0], file) for row in rows[header:]], dtype=np.int64)
        values = np.array([[float(cell or "nan") for cell in row[1:]] for row in rows[header:]])
    except (ValueError, OverflowError) as error:
        raise FileError(f"{file} contains a value that is not a number: {error}.") from None
    return _Table(columns, numbers, values)


def _number(text: str, file: Path) -> int:
    """Return a frame number. Labeled data name an image instead: then it is the last number in the name."""
    try:
        value = float(text)
    except ValueError:
        return last_number(text, str(file))
    if not abs(value) < 2**40:
        raise ValueError(f"frame number {text!r}")
    return int(value)


def _read_h5(file: Path) -> _Table:
    key = _h5_table(file)
    if key is None:
        raise FileError(f"{file} is not a readable HDF5 file ({file.stat().st_size} bytes). Is the file truncated?")
    with open_hdf5(file, "DeepLabCut table") as content:
        group: Any = content[key]
        if "table" not in group:
            return _from_frame(file, read_frame(group))
        columns = load_plain(bytes(group.attrs["non_index_axes"]))[0][1]
        table = np.asarray(group["table"])
        values = np.asarray(table["values_block_0"], dtype=np.float64)
        index = table["index"].tolist()
        numbers = [_number(i.decode() if isinstance(i, bytes) else str(i), file) for i in index]
        named = [tuple(str(word) for word in column)[-3:] for column in columns]
    if values.ndim != 2 or values.shape[1] != len(named) or any(len(name) != 3 for name in named):
        raise FileError(f"{file}: {len(named)} column names do not match values of shape {values.shape}.")
    individuals = [one if len(columns[0]) == len(_MULTI_ANIMAL_HEADER) else "" for one, _, _ in named]
    return _Table(
        [(individual, part, kind) for individual, (_, part, kind) in zip(individuals, named, strict=True)],
        np.array(numbers, dtype=np.int64),
        values,
    )


def _from_frame(file: Path, frame: Frame) -> _Table:
    """Return the content of a table in pandas' fixed layout."""
    if any(len(column) not in (len(_HEADER), len(_MULTI_ANIMAL_HEADER)) for column in frame.columns):
        raise FileError(
            f"{file}: expected column names with the levels {' '.join(_HEADER)} or {' '.join(_MULTI_ANIMAL_HEADER)}."
        )
    many = len(frame.columns[0]) == len(_MULTI_ANIMAL_HEADER)
    columns = [(column[1] if many else "", column[-2], column[-1]) for column in frame.columns]
    return _Table(columns, np.asarray(frame.index, dtype=np.int64), frame.values)


FORMAT = KeypointFormat(
    name="deeplabcut",
    files="a folder of *.csv or *.h5, one per camera, of one animal or several (also EKS)",
    conventions="px; x y likelihood; cameras by the part in which file names differ; no frame rate: `rate_hz`",
    recognized_by="header rows scorer, (individuals,) bodyparts, coords",
    matches=matches,
    read=read,
    camera_files=files_of,
)
