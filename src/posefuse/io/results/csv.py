"""Tidy CSV: one row per frame, person and keypoint (or angle or event). Missing cells are empty; full precision."""

import csv as text_csv
import io
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv

from posefuse.io.files import must_exist, replacing
from posefuse.io.results import tables, tidy
from posefuse.io.results.format import ResultFormat
from posefuse.model.joint_angles import WITHIN_95, AngleStatus, JointAngles
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus, Source
from posefuse.model.stored_points import StoredPoints
from posefuse.model.track_events import Event

FILE_NAMES: dict[LayerName, str] = {"measured": "keypoints.csv", "solved": "solved.csv", "model": "model.csv"}
EVENTS, ANGLES = "events.csv", "angles.csv"

ANGLE_COLUMNS = (
    "frame", "time_s", "person", "angle", "convention", "degrees", "sd_degrees", "low_degrees", "high_degrees",
    "status", "layer",
)  # fmt: skip

_STATUS = np.array([next((s.label for s in PointStatus if s == code), "") for code in range(256)], dtype=object)
_ANGLE_STATUS = np.array([status.label for status in AngleStatus], dtype=object)
_ANGLE_DECIMALS = 3
_SOURCE = np.array([next((s.label for s in Source if s == code), "") for code in range(256)], dtype=object)


def columns(unit: str) -> tuple[str, ...]:
    """Return the column names; lengths have their unit as suffix."""
    positions = tuple(f"{axis}_{unit}" for axis in "xyz")
    deviations = tuple(f"sd_{axis}_{unit}" for axis in "xyz")
    return (
        "frame",
        "time_s",
        "person",
        "keypoint",
        *positions,
        *deviations,
        "n_views",
        "reprojection_error_px",
        "status",
        "source",
    )


def write(parts: Iterable[Reconstruction], path: Path, layer: LayerName) -> None:
    """Write one layer of consecutive ranges of frames of one reconstruction, one range at a time."""
    _write_tables((table_of(part, layer) for part in parts), path)


def write_events(events: Iterable[Event], path: Path) -> None:
    """Write the events of tracks and cameras: ``frame, time_s, person, what, why``."""
    rows = list(events)
    data = [
        pa.array([event.number for event in rows], pa.int64()),
        pa.array([event.time_s for event in rows], pa.float64(), from_pandas=True),
        *(pa.array([getattr(event, name) for event in rows], pa.string()) for name in ("person", "what", "why")),
    ]
    _write_tables([pa.table(data, names=["frame", "time_s", "person", "what", "why"])], path)


def write_angles(parts: Iterable[Reconstruction], path: Path) -> None:
    """Write joint angles of consecutive ranges of frames; frames without a person have no rows."""
    _write_tables((angles_table(part, part.joint_angles) for part in parts if part.joint_angles is not None), path)


def write_columns(tables: Iterable[Mapping[str, np.ndarray]], path: Path) -> None:
    """Write consecutive tables with the same columns as one table; NaN is an empty cell."""
    _write_tables((_columns_table(columns) for columns in tables), path)


def write_plain(tables: Iterable[Mapping[str, np.ndarray]], path: Path) -> None:
    """Write tables with quotes only where necessary, because some programs split the first row at commas."""
    layout = csv.WriteOptions(include_header=False, quoting_style="needed")
    with replacing(path) as temporary, temporary.open("wb") as file, ExitStack() as open_file:
        writer: Any = None
        for columns in tables:
            table = _columns_table(columns)
            if writer is None:
                line = io.StringIO(newline="")
                text_csv.writer(line, lineterminator="\n").writerow(columns)
                file.write(line.getvalue().encode())
                writer = csv.CSVWriter(file, table.schema, write_options=layout)
                open_file.callback(writer.close)
            writer.write_table(table)


def _columns_table(columns: Mapping[str, np.ndarray]) -> pa.Table:
    arrays = [_text(each) if each.dtype == object else pa.array(each, from_pandas=True) for each in columns.values()]
    return pa.table(arrays, names=list(columns))


def _write_tables(tables: Iterable[pa.Table], path: Path) -> None:
    layout = csv.WriteOptions(quoting_style="needed", quoting_header="needed")
    with replacing(path) as temporary, ExitStack() as open_file:
        writer: Any = None  # pyarrow's type stubs declare no constructor of CSVWriter
        for table in tables:
            if writer is None:
                writer = csv.CSVWriter(temporary, table.schema, write_options=layout)
                open_file.callback(writer.close)
            writer.write_table(table)


def table_of(part: Reconstruction, name: LayerName) -> pa.Table:
    """Return a layer as a tidy table."""
    layer = part.layers[name]
    points = np.asarray(layer.points_m[:]).reshape(-1, 3)
    deviations = layer.sd_m.reshape(-1, 3)
    data = [
        *_key_columns(part, part.skeleton.keypoints),
        *(_number(points[:, axis]) for axis in range(3)),
        *(_number(deviations[:, axis]) for axis in range(3)),
        pa.array(layer.n_views.ravel()),
        _number(np.asarray(layer.reprojection_error_px[:])),
        _text(_STATUS[np.asarray(layer.status[:])]),
        _text(_SOURCE[np.asarray(layer.source[:])]),
    ]
    return pa.table(data, names=list(columns(part.unit)))


def angles_table(part: Reconstruction, angles: JointAngles) -> pa.Table:
    """Return joint angles as a tidy table, with 95 % intervals."""
    people = len(part.person_ids)
    status = np.asarray(angles.status[:]).ravel()
    rows = status != AngleStatus.ABSENT
    degrees, sds = (np.asarray(a[:], dtype=np.float64).ravel()[rows] for a in (angles.degrees, angles.sd_deg))
    columns = (degrees, sds, degrees - WITHIN_95 * sds, degrees + WITHIN_95 * sds)
    conventions = np.tile(np.array(angles.conventions, dtype=object), part.n_frames * people)
    data = [
        *(column.filter(pa.array(rows)) for column in _key_columns(part, angles.names)),
        _text(conventions[rows]),
        *(_number(np.round(column, _ANGLE_DECIMALS)) for column in columns),
        _text(_ANGLE_STATUS[status[rows]]),
        _text(np.full(int(rows.sum()), angles.layer, dtype=object)),
    ]
    return pa.table(data, names=list(ANGLE_COLUMNS))


def _key_columns(part: Reconstruction, names: Sequence[str]) -> list[pa.Array]:
    """Return the first four columns; names vary fastest, then people, then frames."""
    people, each = len(part.person_ids), len(names)
    return [
        pa.array(np.repeat(part.frame_numbers, people * each)),
        _number(np.repeat(part.time_s, people * each)),
        _text(np.tile(np.repeat(np.array(part.person_ids, dtype=object), each), part.n_frames)),
        _text(np.tile(np.array(names, dtype=object), part.n_frames * people)),
    ]


def _number(values: np.ndarray) -> pa.Array:
    return pa.array(np.asarray(values, dtype=np.float64).ravel(), from_pandas=True)


def _text(values: np.ndarray) -> pa.Array:
    return pa.array(values.ravel(), pa.string())


def matches(path: Path) -> bool:
    """Return whether a file is a tidy table of points."""
    return {"frame", "time_s", "person", "keypoint"} <= set(tables.header(path))


def read(path: Path) -> StoredPoints:
    """Read a layer; the name of the layer is derived from the file name, if possible.

    Raises:
        FileError: if it is not such a table, or is truncated.
    """
    names = tables.header(must_exist(path, "table of points"))
    tidy.unit_of(names, path)
    kinds = {name: pa.string() if name in tidy.WORDS else pa.float64() for name in names}
    layer = next((layer for layer, name in FILE_NAMES.items() if name == path.name), "")
    return tidy.points_of(tables.read_csv(path, kinds), path, layer=layer)


def _write_layer(result: Reconstruction, path: Path, layer: LayerName) -> None:
    write(result.chunks(), path, layer)


FORMAT = ResultFormat(
    name="csv",
    files="keypoints.csv (measured), solved.csv, model.csv; angles.csv, events.csv",
    conventions="tidy: one row per frame, person and keypoint; meters, world axes; missing is empty",
    lacks="covariances between the axes, and which views",
    holds_stills=True,
    endings=(".csv",),
    matches=matches,
    read=read,
    write_layer=_write_layer,
)
