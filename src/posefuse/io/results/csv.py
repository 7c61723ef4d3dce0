"""Tidy CSV: one row per frame, person and keypoint (or angle or event). Missing cells are empty; full precision."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from posefuse.io.columns import Column, Columns, Words
from posefuse.io.csv_columns import header, read_csv, write_csv
from posefuse.io.files import must_exist
from posefuse.io.results import tidy
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

_STATUS = tuple(next((s.label for s in PointStatus if s == code), "") for code in range(256))
_ANGLE_STATUS = tuple(status.label for status in AngleStatus)
_ANGLE_DECIMALS = 3
_SOURCE = tuple(next((s.label for s in Source if s == code), "") for code in range(256))


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
    write_csv((columns_of(part, layer) for part in parts), path)


def write_events(events: Iterable[Event], path: Path) -> None:
    """Write the events of tracks and cameras: ``frame, time_s, person, what, why``."""
    rows = list(events)
    columns: dict[str, Column] = {
        "frame": np.array([event.number for event in rows], dtype=np.int64),
        "time_s": np.array([event.time_s for event in rows], dtype=np.float64),
    }
    words = {name: Words.of([getattr(event, name) for event in rows]) for name in ("person", "what", "why")}
    write_csv([columns | words], path)


def write_angles(parts: Iterable[Reconstruction], path: Path) -> None:
    """Write joint angles of consecutive ranges of frames; frames without a person have no rows."""
    write_csv((angles_columns(part, part.joint_angles) for part in parts if part.joint_angles is not None), path)


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
    return {"frame", "time_s", "person", "keypoint"} <= set(header(path))


def read(path: Path) -> StoredPoints:
    """Read a layer; the name of the layer is derived from the file name, if possible.

    Raises:
        FileError: if it is not such a table, or is truncated.
    """
    names = header(must_exist(path, "table of points"))
    tidy.unit_of(names, path)
    layer = next((layer for layer, name in FILE_NAMES.items() if name == path.name), "")
    return tidy.points_of(read_csv(path, words=tidy.WORDS, numbers=tidy.NUMBERS), path, layer=layer)


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
