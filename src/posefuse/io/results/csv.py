"""Tidy CSV: one row per frame, person and keypoint (or angle or event). Missing cells are empty.

Points are rounded as in ``reconstruction.nc``: coordinates to 0.001 mm, and finer where the standard deviation is below
0.05 mm, standard deviations and errors to four digits, times to a microsecond. Derived quantities, such as those of
gait, have six digits.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from posefuse.io.columns import Column, Columns, Decimals, Words, number_column
from posefuse.io.csv_columns import header, read_csv, write_rounded_csv
from posefuse.io.files import must_exist
from posefuse.io.results import tidy
from posefuse.io.results.format import ResultFormat
from posefuse.kernels.tables.rows import MAX_DECIMALS
from posefuse.model.joint_angles import WITHIN_95, AngleStatus, JointAngles
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus, Source
from posefuse.model.stored_points import StoredPoints
from posefuse.model.track_events import Event

FILE_NAMES: dict[LayerName, str] = {"measured": "keypoints.csv", "solved": "solved.csv", "model": "model.csv"}
EVENTS, ANGLES = "events.csv", "angles.csv"
PACKED, MAX_ROWS = ".gz", 4_000_000
"""Ending of a compressed table, and how many rows a table beside a result has at most without it."""

ANGLE_COLUMNS = (
    "frame", "time_s", "person", "angle", "convention", "degrees", "sd_degrees", "low_degrees", "high_degrees",
    "status", "layer",
)  # fmt: skip

_STATUS = tuple(next((s.label for s in PointStatus if s == code), "") for code in range(256))
_ANGLE_STATUS = tuple(status.label for status in AngleStatus)
_ANGLE_DECIMALS, _TIME_DECIMALS = 3, 6
_DEGREES = ("degrees", "sd_degrees", "low_degrees", "high_degrees")
_SD_DIGITS, _DERIVED_DIGITS = 4, 6
_COORDINATE_DECIMALS, _COORDINATE_PARTS = 6, 50.0
"""Decimals of a coordinate, and into how many parts its standard deviation is divided at least."""
_SOURCE = tuple(next((s.label for s in Source if s == code), "") for code in range(256))


def file_name(name: str, rows: int) -> str:
    """Return the name of a table beside a result: long ones are compressed."""
    return name if rows <= MAX_ROWS else name + PACKED


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
    write_rounded_csv((_rounded(columns_of(part, layer), part.unit) for part in parts), path)


def write_events(events: Iterable[Event], path: Path) -> None:
    """Write the events of tracks and cameras: ``frame, time_s, person, what, why``."""
    rows = list(events)
    numbers: dict[str, Column] = {
        "frame": np.array([event.number for event in rows], dtype=np.int64),
        "time_s": np.array([event.time_s for event in rows], dtype=np.float64),
    }
    words = {name: Words.of([getattr(event, name) for event in rows]) for name in ("person", "what", "why")}
    write_table([numbers | words], path)


def write_table(tables: Iterable[Columns], path: Path) -> None:
    """Write consecutive tables of derived quantities as one, with six digits."""
    write_rounded_csv((_significant(table) for table in tables), path)


def write_angles(parts: Iterable[Reconstruction], path: Path) -> None:
    """Write joint angles of consecutive ranges of frames; frames without a person have no rows."""
    tables = (angles_columns(part, part.joint_angles) for part in parts if part.joint_angles is not None)
    write_rounded_csv((_decimals(table, dict.fromkeys(_DEGREES, _ANGLE_DECIMALS)) for table in tables), path)


def columns_of(part: Reconstruction, name: LayerName) -> dict[str, Column]:
    """Return a layer as a tidy table."""
    layer = part.layers[name]
    points = np.asarray(layer.points_m[:]).reshape(-1, 3)
    deviations = layer.sd_m.reshape(-1, 3)
    data = [
        *_key_columns(part, part.skeleton.keypoints),
        *(_number(points[:, axis]) for axis in range(3)),
        *(_number(deviations[:, axis]) for axis in range(3)),
        layer.n_views.ravel(),
        _number(np.asarray(layer.reprojection_error_px[:])),
        Words(np.asarray(layer.status[:]).ravel(), _STATUS),
        Words(np.asarray(layer.source[:]).ravel(), _SOURCE),
    ]
    return dict(zip(columns(part.unit), data, strict=True))


def _rounded(table: Columns, unit: str) -> dict[str, Decimals | Words]:
    """Return a table of points with the decimals that its numbers are written with."""
    deviations = [number_column(table, f"sd_{axis}_{unit}") for axis in "xyz"]
    smallest = np.fmin.reduce(deviations)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.ceil(np.log10(_COORDINATE_PARTS / smallest))
    coordinates = np.nan_to_num(needed, nan=MAX_DECIMALS, posinf=MAX_DECIMALS).clip(_COORDINATE_DECIMALS, MAX_DECIMALS)
    decimals: dict[str, np.ndarray | int] = {f"{axis}_{unit}": coordinates.astype(np.int64) for axis in "xyz"}
    for name in (*(f"sd_{axis}_{unit}" for axis in "xyz"), "reprojection_error_px"):
        decimals[name] = _for_digits(number_column(table, name), _SD_DIGITS)
    return _decimals(table, decimals)


def _significant(table: Columns) -> dict[str, Decimals | Words]:
    """Return a table with the decimals that show six digits of its numbers."""
    rounded: dict[str, Decimals | Words] = {}
    for name, column in table.items():
        if isinstance(column, Words) or column.dtype == object:
            rounded[name] = column if isinstance(column, Words) else Words.of(column)
            continue
        values = np.ma.filled(np.ma.asarray(column).astype(np.float64), np.nan)
        whole = not np.issubdtype(column.dtype, np.floating)
        decimals = 0 if whole else _for_digits(np.abs(values), _DERIVED_DIGITS)
        rounded[name] = Decimals(values, _TIME_DECIMALS if name == "time_s" else decimals)
    return rounded


def _for_digits(values: np.ndarray, digits: int) -> np.ndarray:
    """Return the numbers of decimals that write positive numbers with ``digits`` digits, shape (row,), int64."""
    with np.errstate(divide="ignore", invalid="ignore"):
        first = np.nan_to_num(np.floor(np.log10(values)), nan=0.0, neginf=0.0, posinf=0.0)
    return (digits - 1 - first).clip(0, MAX_DECIMALS).astype(np.int64)


def _decimals(table: Columns, decimals: Mapping[str, np.ndarray | int]) -> dict[str, Decimals | Words]:
    """Return a table with the decimals of its columns; whole numbers have none, and times those of a microsecond."""
    known = {"time_s": _TIME_DECIMALS, **decimals}
    return {
        name: column if isinstance(column, Words) else Decimals(column, known.get(name, 0))
        for name, column in table.items()
    }


def angles_columns(part: Reconstruction, angles: JointAngles) -> Columns:
    """Return joint angles as a tidy table, with 95 % intervals."""
    people = len(part.person_ids)
    status = np.asarray(angles.status[:]).ravel()
    rows = status != AngleStatus.ABSENT
    degrees, sds = (np.asarray(a[:], dtype=np.float64).ravel()[rows] for a in (angles.degrees, angles.sd_deg))
    numbers = (degrees, sds, degrees - WITHIN_95 * sds, degrees + WITHIN_95 * sds)
    conventions = np.tile(np.arange(len(angles.conventions)), part.n_frames * people)
    data = [
        *(column[rows] for column in _key_columns(part, angles.names)),
        Words(conventions[rows], tuple(angles.conventions)),
        *(np.round(column, _ANGLE_DECIMALS) for column in numbers),
        Words(status[rows], _ANGLE_STATUS),
        Words(np.zeros(int(rows.sum()), dtype=np.int64), (angles.layer,)),
    ]
    return dict(zip(ANGLE_COLUMNS, data, strict=True))


def _key_columns(part: Reconstruction, names: Sequence[str]) -> list[Column]:
    """Return the first four columns; names vary fastest, then people, then frames."""
    people, each = len(part.person_ids), len(names)
    return [
        np.repeat(part.frame_numbers, people * each),
        _number(np.repeat(part.time_s, people * each)),
        Words(np.tile(np.repeat(np.arange(people), each), part.n_frames), tuple(part.person_ids)),
        Words(np.tile(np.arange(each), part.n_frames * people), tuple(names)),
    ]


def _number(values: np.ndarray) -> np.ndarray:
    return np.asarray(values, dtype=np.float64).ravel()


def matches(path: Path) -> bool:
    """Return whether a file is a tidy table of points."""
    is_table = path.name.lower().endswith((".csv", f".csv{PACKED}"))
    return is_table and {"frame", "time_s", "person", "keypoint"} <= set(header(path))


def read(path: Path) -> StoredPoints:
    """Read a layer; the name of the layer is derived from the file name, if possible.

    Raises:
        FileError: if it is not such a table, or is truncated.
    """
    names = header(must_exist(path, "table of points"))
    tidy.unit_of(names, path)
    layer = next((layer for layer, name in FILE_NAMES.items() if name == path.name.removesuffix(PACKED)), "")
    return tidy.points_of(read_csv(path, words=tidy.WORDS, numbers=tidy.NUMBERS), path, layer=layer)


def _write_layer(result: Reconstruction, path: Path, layer: LayerName) -> None:
    write(result.windows(), path, layer)


FORMAT = ResultFormat(
    name="csv",
    files="keypoints.csv (measured), solved.csv, model.csv; angles.csv, events.csv",
    conventions="tidy: one row per frame, person and keypoint; meters, world axes; missing is empty",
    lacks="covariances between the axes, and which views",
    holds_stills=True,
    endings=(".csv", PACKED),
    matches=matches,
    read=read,
    write_layer=_write_layer,
)
