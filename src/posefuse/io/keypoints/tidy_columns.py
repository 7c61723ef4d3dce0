"""Tidy tables of 2D keypoints: one row per camera, frame, person and keypoint, in CSV and parquet.

| column | content |
|---|---|
| ``camera`` | name of the view |
| ``frame`` | number of the frame |
| ``time_s`` | time of the frame in this view; empty if unknown |
| ``person`` | index of the detected person in this view and frame, from 0 |
| ``track`` | identity of the person in this view, as stated by the detector; empty without one |
| ``keypoint`` | name of the keypoint |
| ``x_px``, ``y_px``, ``confidence`` | empty if not detected |
| ``sigma_px``, ``depth`` | optional |

A recorded frame without people has one row per view, in which ``person`` and ``keypoint`` are empty. A frame that a
view did not record has no row. Rows are written ordered by frame, view, person and keypoint, and read in any order.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.columns import Column, Columns, Words, n_rows, number_column
from posefuse.io.keypoints.columns import ViewColumns, assemble
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.skeleton.from_names import skeleton_named
from posefuse.skeleton.skeletons import Skeleton

REQUIRED_COLUMNS = ("camera", "frame", "keypoint", "x_px", "y_px")
NUMBER_COLUMNS = ("x_px", "y_px", "confidence", "sigma_px", "depth")
COLUMN_KINDS: dict[str, tuple[str, ...]] = {
    "words": ("camera", "keypoint"),
    "numbers": ("frame", "time_s", "person", "track", *NUMBER_COLUMNS),
}
_MAX_INTEGER = 2**40


def columns_of_detections(detections: Detections) -> dict[str, Column]:
    """Return detections as a table."""
    n_keypoints = len(detections.skeleton)
    people = detections.people_counts.ravel()
    without_people = (people == 0) & detections.recorded.ravel()
    lines = np.where(without_people, 1, people * n_keypoints)
    cell = np.repeat(np.arange(len(lines)), lines)
    empty = without_people[cell]
    within = np.arange(len(cell)) - np.repeat(np.cumsum(lines) - lines, lines)
    row = np.where(empty, 0, detections.offsets[cell] + within // n_keypoints)
    frame, view = np.divmod(cell, detections.n_views)

    def flat(values: Any) -> np.ndarray:
        column = np.full(len(cell), np.nan)
        column[~empty] = np.asarray(values, dtype=np.float64).ravel()
        return column

    tracks = np.full(len(cell), -1)
    tracks[~empty] = np.asarray(detections.track_ids)[row[~empty]]
    columns: dict[str, Column] = {
        "camera": Words(view, detections.view_names),
        "frame": np.asarray(detections.frame_numbers[frame], dtype=np.int64),
        "time_s": np.asarray(detections.time_s, dtype=np.float64).ravel()[cell],
        "person": np.ma.masked_array(within // n_keypoints, empty),
        "track": np.ma.masked_array(tracks, tracks == -1),
        "keypoint": Words(np.where(empty, -1, within % n_keypoints), detections.skeleton.keypoints),
        "x_px": flat(np.asarray(detections.keypoints_px)[..., 0]),
        "y_px": flat(np.asarray(detections.keypoints_px)[..., 1]),
        "confidence": flat(detections.confidence),
    }
    for name in ("sigma_px", "depth"):
        if getattr(detections, name) is not None:
            columns[name] = flat(getattr(detections, name))
    return columns


@dataclass(frozen=True)
class _Lines:
    """The columns of a table, with NaN or -1 for empty cells.

    Attributes:
        cameras: Names of the cameras, in the order of the views.
        keypoints: Names of the keypoints, in order.
        camera: Shape (line,): index of the camera.
        frame: Shape (line,), int64: frame number.
        time_s: Shape (line,).
        person: Shape (line,), int64: index of the person.
        track: Shape (line,), int64.
        keypoint: Shape (line,): index of the keypoint, -1 for a frame without people.
        values: Columns of numbers by name, each of shape (line,).
    """

    cameras: tuple[str, ...]
    keypoints: tuple[str, ...]
    camera: np.ndarray
    frame: np.ndarray
    time_s: np.ndarray
    person: np.ndarray
    track: np.ndarray
    keypoint: np.ndarray
    values: dict[str, np.ndarray]


def detections_of_columns(
    path: Path,
    table: Columns,
    request: Request,
    cameras: Sequence[str] | None = None,
    skeleton: Skeleton | None = None,
) -> Detections:
    """Return the detections of a table.

    Args:
        path: The file, for messages.
        table: Columns with at least ``REQUIRED_COLUMNS``.
        request: How to read the file.
        cameras: Names of the views in order, if stated by the file. Default: the sorted names of the table.
        skeleton: Skeleton stated by the file. Default: from the keypoint names.

    Raises:
        FileError: If a column is missing or invalid, a keypoint occurs twice, or nothing identifies the skeleton.
    """
    lines = _lines(path, table, cameras, request.skeleton or skeleton)
    if not lines.keypoints:
        raise FileError(f"{path} has no row with a keypoint, so its skeleton is unknown. Set `skeleton`.")
    named = request.skeleton or skeleton or skeleton_named("tidy", lines.keypoints)
    views = [_view(path, lines, v, len(named)) for v in range(len(lines.cameras))]
    return assemble(path, views, named, request.rate_hz)


def _lines(path: Path, table: Columns, cameras: Sequence[str] | None, skeleton: Skeleton | None) -> _Lines:
    missing = [name for name in REQUIRED_COLUMNS if name not in table]
    if missing:
        raise FileError(f"{path} has no column {choices(missing)}; it has {choices(list(table))}.")
    camera, in_table = _coded(path, table, "camera")
    names = tuple(cameras) if cameras is not None else tuple(sorted(in_table))
    if not set(in_table) <= set(names):
        raise FileError(f"{path} lists the cameras {choices(names)}, but has rows for {choices(in_table)}.")
    keypoint, parts = _coded(path, table, "keypoint")
    order = tuple(parts) if skeleton is None else skeleton.keypoints
    unknown = [part for part in parts if part not in order]
    if unknown and skeleton is not None:
        raise FileError(
            f"{path} has the keypoints {choices(unknown)}, which skeleton {skeleton.name} lacks. Omit `skeleton` to "
            "use the names of the file."
        )
    person = _integers(path, table, "person") if "person" in table else None
    track = _integers(path, table, "track") if "track" in table else np.full(n_rows(table), -1)
    if person is None:
        person = np.where(track >= 0, track, 0)
    views = np.array([names.index(name) for name in in_table] or [0])
    columns = np.array([order.index(part) for part in parts] or [0])
    return _Lines(
        cameras=names,
        keypoints=order,
        camera=views[camera],
        frame=_integers(path, table, "frame", empty=False),
        time_s=number_column(table, "time_s") if "time_s" in table else np.full(n_rows(table), np.nan),
        person=person,
        track=track,
        keypoint=np.where(keypoint >= 0, columns[keypoint], -1),
        values={name: number_column(table, name) for name in NUMBER_COLUMNS if name in table},
    )


def _coded(path: Path, table: Columns, name: str) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return a column of names as codes, -1 for empty cells, and the names in order of first occurrence."""
    column = table[name]
    assert isinstance(column, Words)
    if name == "camera" and (column.codes < 0).any():
        raise FileError(f"{path}, row {int(np.argmax(column.codes < 0)) + 1}: the column camera is empty.")
    return column.codes, column.names


def _integers(path: Path, table: Columns, name: str, *, empty: bool = True) -> np.ndarray:
    values = number_column(table, name)
    missing = np.isnan(values)
    bad = (~missing & ((values != np.round(values)) | (np.abs(values) > _MAX_INTEGER))) | (missing & (not empty))
    if bad.any():
        row = int(np.argmax(bad))
        got = "nothing" if missing[row] else f"{values[row]:g}"
        raise FileError(f"{path}, row {row + 1}: expected an integer for {name}, got {got}.")
    return np.where(missing, -1, values).astype(np.int64)


def _view(path: Path, lines: _Lines, view: int, n_keypoints: int) -> ViewColumns:
    in_view = lines.camera == view
    recorded, first = np.unique(lines.frame[in_view], return_index=True)
    detected = np.flatnonzero(in_view & (lines.keypoint >= 0))
    if (lines.person[detected] < 0).any():
        row = int(detected[np.argmax(lines.person[detected] < 0)])
        raise FileError(f"{path}, row {row + 1}: a keypoint has no person: the column person is empty.")
    keys, start, row = np.unique(
        np.stack([lines.frame[detected], lines.person[detected]], axis=1),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    slots = row.ravel() * n_keypoints + lines.keypoint[detected]
    used, counts = np.unique(slots, return_counts=True)
    if (counts > 1).any():
        repeated = int(detected[np.flatnonzero(slots == used[np.argmax(counts > 1)])[1]])
        raise FileError(
            f"{path}, row {repeated + 1}: {lines.keypoints[lines.keypoint[repeated]]} of person "
            f"{lines.person[repeated]} occurs twice in frame {lines.frame[repeated]} of camera {lines.cameras[view]}."
        )

    def spread(name: str) -> np.ndarray:
        values = np.full(len(keys) * n_keypoints, np.nan)
        if name in lines.values:
            values[slots] = lines.values[name][detected]
        return values.reshape(len(keys), n_keypoints)

    pixels = np.stack([spread("x_px"), spread("y_px")], axis=-1)
    pixels[np.isnan(pixels).any(axis=-1)] = np.nan
    return ViewColumns(
        name=lines.cameras[view],
        recorded=recorded,
        frame_of_row=keys[:, 0] if len(keys) else np.empty(0, np.int64),
        keypoints=np.concatenate([pixels, spread("confidence")[..., None]], axis=-1),
        track_ids=lines.track[detected][start],
        sigma_px=spread("sigma_px") if "sigma_px" in lines.values else None,
        depth=spread("depth") if "depth" in lines.values else None,
        time_s=lines.time_s[in_view][first],
    )
