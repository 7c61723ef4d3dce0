"""2D keypoints as a tidy table: a row a camera, frame, person and keypoint; what CSV and parquet share.

| column | what |
|---|---|
| ``camera`` | name of the view |
| ``frame`` | number of the frame |
| ``time_s`` | when the view took it; empty where nobody knows |
| ``person`` | which of the people that the detector saw in this view and frame, from 0 |
| ``track`` | the detector's own identity of the person in this view; empty where it has none |
| ``keypoint`` | its name |
| ``x_px``, ``y_px``, ``confidence`` | empty where not detected |
| ``sigma_px``, ``depth`` | where there are any |

A view that has a frame but shows nobody in it has one row of it, whose ``person`` and ``keypoint`` are empty; of frames
that it does not have it has none. Rows are ordered by frame, view, person and keypoint when written, not when read.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.keypoints.columns import ViewColumns, assemble
from posefuse.io.keypoints.names import skeleton_named
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton

NEEDED = ("camera", "frame", "keypoint", "x_px", "y_px")
NUMBERS = ("x_px", "y_px", "confidence", "sigma_px", "depth")
_LARGEST = 2**40


def table_of(detections: Detections) -> Any:
    """Detections in memory as an Arrow table."""
    import pyarrow as pa

    n_keypoints = len(detections.skeleton)
    people = detections.people_counts.ravel()
    alone = (people == 0) & detections.recorded.ravel()
    lines = np.where(alone, 1, people * n_keypoints)
    cell = np.repeat(np.arange(len(lines)), lines)
    empty = alone[cell]
    within = np.arange(len(cell)) - np.repeat(np.cumsum(lines) - lines, lines)
    row = np.where(empty, 0, detections.offsets[cell] + within // n_keypoints)
    frame, view = np.divmod(cell, detections.n_views)

    def chosen(values: Any, missing: np.ndarray, kind: Any) -> Any:
        return pa.array(values, kind, mask=missing)

    def flat(values: Any) -> Any:
        taken = np.full(len(cell), np.nan)
        taken[~empty] = np.asarray(values, dtype=np.float64).ravel()
        return chosen(taken, np.isnan(taken), pa.float64())

    def named(codes: np.ndarray, missing: np.ndarray | None, names: Sequence[str]) -> Any:
        indices = pa.array(codes.astype(np.int32), pa.int32(), mask=missing)
        return pa.DictionaryArray.from_arrays(indices, pa.array(list(names), pa.string()))

    times = detections.time_s.ravel()[cell]
    tracks = np.full(len(cell), -1)
    tracks[~empty] = np.asarray(detections.track_ids)[row[~empty]]
    columns = {
        "camera": named(view, None, detections.view_names),
        "frame": pa.array(detections.frame_numbers[frame], pa.int64()),
        "time_s": chosen(times, np.isnan(times), pa.float64()),
        "person": chosen(within // n_keypoints, empty, pa.int64()),
        "track": chosen(tracks, tracks == -1, pa.int64()),
        "keypoint": named(within % n_keypoints, empty, detections.skeleton.keypoints),
        "x_px": flat(np.asarray(detections.keypoints_px)[..., 0]),
        "y_px": flat(np.asarray(detections.keypoints_px)[..., 1]),
        "confidence": flat(detections.confidence),
    }
    for name in ("sigma_px", "depth"):
        if getattr(detections, name) is not None:
            columns[name] = flat(getattr(detections, name))
    return pa.table(columns)


@dataclass(frozen=True)
class _Lines:
    """The columns of a table; NaN, or -1, where a cell is empty.

    Attributes:
        cameras: names, in the order of the views.
        keypoints: names, in their order.
        camera: shape (line,): which camera.
        frame: shape (line,), int64.
        time_s: shape (line,).
        person: shape (line,), int64.
        track: shape (line,), int64.
        keypoint: shape (line,): which keypoint, -1 where there is nobody.
        values: the columns of numbers that there are, each of shape (line,).
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


def detections_of_table(
    path: Path,
    table: Any,
    request: Request,
    cameras: Sequence[str] | None = None,
    skeleton: Skeleton | None = None,
) -> Detections:
    """The detections of a table in memory.

    Args:
        path: for messages.
        table: an Arrow table with the columns above; ``NEEDED`` must be there.
        request: what the user said.
        cameras: names of the views in their order, where something says; by default they are sorted.
        skeleton: of the keypoints, where something says.

    Raises:
        FileError: if a column is missing or holds something else, or a keypoint is there twice.
    """
    lines = _lines(path, table, cameras, request.skeleton or skeleton)
    named = request.skeleton or skeleton or skeleton_named("tidy", lines.keypoints)
    views = [_view(path, lines, v, len(named)) for v in range(len(lines.cameras))]
    return assemble(path, views, named, request.rate_hz)


def _lines(path: Path, table: Any, cameras: Sequence[str] | None, skeleton: Skeleton | None) -> _Lines:
    lacking = [name for name in NEEDED if name not in table.column_names]
    if lacking:
        raise FileError(f"{path} has no column {choices(lacking)}; it has {choices(table.column_names)}.")
    camera, found = _coded(path, table, "camera")
    names = tuple(cameras) if cameras is not None else tuple(sorted(found))
    if not set(found) <= set(names):
        raise FileError(f"{path} says it is of the cameras {choices(names)}, but has rows of {choices(found)}.")
    keypoint, parts = _coded(path, table, "keypoint")
    order = tuple(parts) if skeleton is None else skeleton.keypoints
    unknown = [part for part in parts if part not in order]
    if unknown and skeleton is not None:
        raise FileError(
            f"{path} has the keypoints {choices(unknown)}, which skeleton {skeleton.name} has not. Leave --skeleton "
            "out to take the names of the file."
        )
    person = _whole(path, table, "person") if "person" in table.column_names else None
    track = _whole(path, table, "track") if "track" in table.column_names else np.full(len(table), -1)
    if person is None:
        person = np.where(track >= 0, track, 0)
    places = np.array([names.index(name) for name in found] or [0])
    columns = np.array([order.index(part) for part in parts] or [0])
    return _Lines(
        cameras=names,
        keypoints=order,
        camera=places[camera],
        frame=_whole(path, table, "frame", empty=False),
        time_s=_numbers(path, table, "time_s") if "time_s" in table.column_names else np.full(len(table), np.nan),
        person=person,
        track=track,
        keypoint=np.where(keypoint >= 0, columns[keypoint], -1),
        values={name: _numbers(path, table, name) for name in NUMBERS if name in table.column_names},
    )


def _coded(path: Path, table: Any, name: str) -> tuple[np.ndarray, list[str]]:
    """A column of names as codes, -1 where empty, and the names in the order they come in."""
    import pyarrow as pa

    try:
        column = table.column(name).cast(pa.string()).combine_chunks().dictionary_encode()
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError, pa.ArrowTypeError) as error:
        raise FileError(f"{path}: the column {name} does not hold names: {error}.") from None
    if name == "camera" and column.null_count:
        raise FileError(f"{path}, row {int(np.flatnonzero(column.is_null())[0]) + 1}: no camera.")
    codes = column.indices.fill_null(-1).to_numpy(zero_copy_only=False)
    return codes.astype(np.int64), column.dictionary.to_pylist()


def _numbers(path: Path, table: Any, name: str) -> np.ndarray:
    import pyarrow as pa

    try:
        return table.column(name).cast(pa.float64()).to_numpy(zero_copy_only=False).astype(np.float64)
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError, pa.ArrowTypeError, ValueError, TypeError) as error:
        raise FileError(f"{path}: the column {name} should hold numbers: {error}.") from None


def _whole(path: Path, table: Any, name: str, *, empty: bool = True) -> np.ndarray:
    values = _numbers(path, table, name)
    missing = np.isnan(values)
    bad = (~missing & ((values != np.round(values)) | (np.abs(values) > _LARGEST))) | (missing & (not empty))
    if bad.any():
        row = int(np.argmax(bad))
        got = "nothing" if missing[row] else f"{values[row]:g}"
        raise FileError(f"{path}, row {row + 1}: {name} should be a whole number, got {got}.")
    return np.where(missing, -1, values).astype(np.int64)


def _view(path: Path, lines: _Lines, view: int, n_keypoints: int) -> ViewColumns:
    mine = lines.camera == view
    recorded, first = np.unique(lines.frame[mine], return_index=True)
    there = np.flatnonzero(mine & (lines.keypoint >= 0))
    if (lines.person[there] < 0).any():
        row = int(there[np.argmax(lines.person[there] < 0)])
        raise FileError(f"{path}, row {row + 1}: a keypoint of nobody: the column person is empty.")
    keys, start, row = np.unique(
        np.stack([lines.frame[there], lines.person[there]], axis=1), axis=0, return_index=True, return_inverse=True
    )
    places = row.ravel() * n_keypoints + lines.keypoint[there]
    taken, counts = np.unique(places, return_counts=True)
    if (counts > 1).any():
        twice = int(there[np.flatnonzero(places == taken[np.argmax(counts > 1)])[1]])
        raise FileError(
            f"{path}, row {twice + 1}: {lines.keypoints[lines.keypoint[twice]]} of person {lines.person[twice]} is "
            f"there twice in frame {lines.frame[twice]} of camera {lines.cameras[view]}."
        )

    def spread(name: str) -> np.ndarray:
        values = np.full(len(keys) * n_keypoints, np.nan)
        if name in lines.values:
            values[places] = lines.values[name][there]
        return values.reshape(len(keys), n_keypoints)

    pixels = np.stack([spread("x_px"), spread("y_px")], axis=-1)
    pixels[np.isnan(pixels).any(axis=-1)] = np.nan
    return ViewColumns(
        name=lines.cameras[view],
        recorded=recorded,
        frame_of_row=keys[:, 0] if len(keys) else np.empty(0, np.int64),
        keypoints=np.concatenate([pixels, spread("confidence")[..., None]], axis=-1),
        track_ids=lines.track[there][start],
        sigma_px=spread("sigma_px") if "sigma_px" in lines.values else None,
        depth=spread("depth") if "depth" in lines.values else None,
        time_s=lines.time_s[mine][first],
    )
