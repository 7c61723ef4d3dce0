"""Tidy tables in parquet, written and read by ranges of frames: only the requested ranges are in memory."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.arrays import ranges
from posefuse.errors import FileError
from posefuse.io.arrow import arrow_table, columns_of, import_pyarrow
from posefuse.io.files import reading
from posefuse.io.keypoints.columns import common_frames
from posefuse.io.keypoints.parquet_metadata import RecordingMetadata, column_names, metadata_of, read_metadata
from posefuse.io.keypoints.request import Request, apply_request
from posefuse.io.keypoints.tidy_columns import COLUMN_KINDS, columns_of_detections, detections_of_columns
from posefuse.io.parquet_files import check_parquet, check_row_groups
from posefuse.lazy_array import LazyArray, as_array
from posefuse.model.detections import Detections

_GROUP_LINES = 200_000
"""Approximate number of rows of a row group, which is read at once."""


def write(detections: Detections, path: Path) -> None:
    """Write a table with one row group per range of frames."""
    size = frames_per_group(detections.n_frames, int(detections.offsets[-1]), len(detections.skeleton))
    spans = list(ranges(detections.n_frames, size)) or [(0, 0)]
    write_parts((detections.frames(start, stop) for start, stop in spans), path)


def frames_per_group(n_frames: int, n_rows: int, n_keypoints: int) -> int:
    """Return the number of frames of a row group, from the number of detections of all frames."""
    return max(_GROUP_LINES // max(n_rows * n_keypoints // max(n_frames, 1), 1), 1)


def write_parts(parts: Iterable[Detections], path: Path) -> None:
    """Write consecutive ranges of the frames of a recording, at least one, as one row group each."""
    pq = import_pyarrow().parquet
    remaining = iter(parts)
    first = next(remaining)
    schema = _table(first.frames(0, 0)).schema.with_metadata(metadata_of(first))
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        for part in chain([first], remaining):
            table = _table(part).replace_schema_metadata(schema.metadata)
            writer.write_table(table, row_group_size=max(len(table), 1))


def _table(part: Detections) -> Any:
    return arrow_table(columns_of_detections(part), coded_words=True)


def read(path: Path, request: Request) -> Detections:
    """Read a table: by ranges if posefuse wrote it, otherwise completely.

    Raises:
        FileError: If the file is truncated, or a column has invalid content.
    """
    pq = import_pyarrow().parquet
    with reading(path, "parquet file"):
        recording = read_metadata(path, pq.read_schema(path).metadata)
        if recording is None:
            check_parquet(path)
            return detections_of_columns(path, columns_of(path, pq.read_table(path), **COLUMN_KINDS), request)
        check_row_groups(path)
        index = _index(path, recording)
        if index is None:
            check_parquet(path)
            columns = columns_of(path, pq.read_table(path), **COLUMN_KINDS)
            detections = detections_of_columns(path, columns, Request(), recording.views, recording.skeleton)
            return apply_request(detections, request, path)
        return apply_request(_stored(path, recording, index), request, path)


@dataclass(frozen=True)
class _Index:
    """Position of people in the file. A cell is a recorded frame of a view.

    Attributes:
        frame: Shape (cell,): frame numbers, ordered by frame and view.
        view: Shape (cell,).
        time_s: Shape (cell,).
        people: Shape (cell,): number of people.
        group_ends: Shape (row group + 1,): number of people before each row group.
    """

    frame: np.ndarray
    view: np.ndarray
    time_s: np.ndarray
    people: np.ndarray
    group_ends: np.ndarray


def _index(path: Path, recording: RecordingMetadata) -> _Index | None:
    """Index the file one row group at a time. Returns None if its rows were reordered since posefuse wrote it."""
    pq = import_pyarrow().parquet
    cells: list[tuple[np.ndarray, ...]] = []
    counts, last = [0], -1
    with pq.ParquetFile(path) as file:
        for group in range(file.num_row_groups):
            group_cells = _cells_of_group(file, group, recording)
            if group_cells is None or (len(group_cells[0]) and group_cells[0][0] <= last):
                return None
            cells.append(group_cells)
            counts.append(int(group_cells[3].sum()))
            last = int(group_cells[0][-1]) if len(group_cells[0]) else last
    if not cells or last < 0:
        raise FileError(f"{path} is an empty recording: it has no frames.")
    key, times, _, people = (np.concatenate(part) for part in zip(*cells, strict=True))
    frame, view = np.divmod(key, len(recording.views))
    return _Index(frame, view, times, people, np.cumsum(counts))


def _cells_of_group(file: Any, group: int, recording: RecordingMetadata) -> tuple[np.ndarray, ...] | None:
    """Return key, time, first line and number of people of each cell of a row group, or None if rows are unordered."""
    table = file.read_row_group(group, columns=["camera", "frame", "time_s", "keypoint"])
    view = _indices(table["camera"], recording.views)
    keypoint = _indices(table["keypoint"], recording.skeleton.keypoints)
    key = table["frame"].to_numpy() * len(recording.views) + view
    detected = keypoint >= 0
    n_keypoints = len(recording.skeleton)
    in_order = (
        len(keypoint[detected]) % n_keypoints == 0
        and (keypoint[detected].reshape(-1, n_keypoints) == np.arange(n_keypoints)).all()
    )
    blocks = key[detected].reshape(-1, n_keypoints) if in_order else key[:0].reshape(0, 1)
    if not in_order or (view < 0).any() or (np.diff(key) < 0).any() or (blocks != blocks[:, :1]).any():
        return None
    keys, first, lines = np.unique(key, return_index=True, return_counts=True)
    without_people = ~detected[first]
    if (without_people & (lines > 1)).any():
        return None
    time_s = table["time_s"].to_numpy()[first].astype(np.float64)
    return keys, time_s, first, np.where(without_people, 0, lines // n_keypoints)


def _indices(column: Any, names: Sequence[str]) -> np.ndarray:
    """Return the index of each cell's name, -1 if it is none of the names."""
    pa = import_pyarrow()
    options = pa.compute.SetLookupOptions(pa.array(list(names), pa.string()))
    return pa.compute.call_function("index_in", [column.cast(pa.string())], options).fill_null(-1).to_numpy()


def _stored(path: Path, recording: RecordingMetadata, index: _Index) -> Detections:
    numbers = common_frames(path, index.frame, own=True)
    shape = len(numbers), len(recording.views)
    recorded, times, people = np.zeros(shape, dtype=bool), np.full(shape, np.nan), np.zeros(shape, dtype=np.int64)
    cells = np.searchsorted(numbers, index.frame), index.view
    recorded[cells], times[cells], people[cells] = True, index.time_s, index.people
    columns = column_names(path)

    def stored(*names: str) -> np.ndarray | None:
        if names[0] not in columns:
            return None
        return as_array(_StoredColumns(path, names, index.group_ends, len(recording.skeleton)))

    pixels, confidence = stored("x_px", "y_px"), stored("confidence")
    assert pixels is not None
    assert confidence is not None
    return Detections(
        skeleton=recording.skeleton,
        view_names=recording.views,
        frame_numbers=numbers,
        time_s=times,
        offsets=np.concatenate([[0], np.cumsum(people)]),
        keypoints_px=pixels,
        confidence=confidence,
        recorded=recorded,
        track_ids=as_array(_StoredTracks(path, index.group_ends, len(recording.skeleton))),
        depth=stored("depth"),
        sigma_px=stored("sigma_px"),
        rate_hz=recording.rate_hz,
        notes=recording.notes,
    )


class _StoredColumns(LazyArray):
    """Columns of the file, which is open only during a read."""

    def __init__(self, path: Path, names: tuple[str, ...], group_ends: np.ndarray, n_keypoints: int) -> None:
        super().__init__((int(group_ends[-1]), n_keypoints, *((len(names),) if len(names) > 1 else ())), np.float64)
        self._path, self._names, self._ends = path, names, group_ends

    def read_rows(self, start: int, stop: int) -> np.ndarray:
        """Read the rows from the row groups that contain them."""
        return np.concatenate(list(self._parts(start, stop)))

    def _parts(self, start: int, stop: int) -> Iterator[np.ndarray]:
        pq = import_pyarrow().parquet
        first = int(np.searchsorted(self._ends, start, side="right")) - 1
        with reading(self._path, "parquet file"), pq.ParquetFile(self._path) as file:
            for group in range(first, len(self._ends) - 1):
                begin, end = int(self._ends[group]), int(self._ends[group + 1])
                if begin >= stop:
                    return
                if end > begin:
                    yield self._group(file, group)[max(start - begin, 0) : stop - begin]

    def _group(self, file: Any, group: int) -> np.ndarray:
        """Return the rows of a row group, one per person."""
        table = file.read_row_group(group, columns=[*self._names, "keypoint"])
        detected = table["keypoint"].is_valid().to_numpy()
        values = [table[name].to_numpy()[detected].astype(np.float64) for name in self._names]
        return np.stack(values, axis=-1).reshape(-1, *self.shape[1:])


class _StoredTracks(_StoredColumns):
    """The track ids of people in the file."""

    def __init__(self, path: Path, group_ends: np.ndarray, n_keypoints: int) -> None:
        super().__init__(path, ("track",), group_ends, n_keypoints)
        self.shape, self.dtype, self._n_keypoints = (int(group_ends[-1]),), np.dtype(np.int64), n_keypoints

    def _group(self, file: Any, group: int) -> np.ndarray:
        table = file.read_row_group(group, columns=["track", "keypoint"])
        detected = table["keypoint"].is_valid().to_numpy()
        tracks = table["track"].fill_null(-1).to_numpy()
        return tracks[detected][:: self._n_keypoints].astype(np.int64)
