"""Tidy tables in parquet, written and read by ranges of frames: only the ranges asked for are ever in memory."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.arrays import ranges
from posefuse.errors import FileError
from posefuse.io.files import reading
from posefuse.io.keypoints.columns import line_of_frames
from posefuse.io.keypoints.lazy_columns import RowsByRange
from posefuse.io.keypoints.parquet_metadata import About, about_of, column_names, metadata_of
from posefuse.io.keypoints.request import Request, asked_of
from posefuse.io.keypoints.tidy_columns import detections_of_table, table_of
from posefuse.io.parquet_files import check_parquet, check_row_groups
from posefuse.model.detections import Detections

_LINES = 200_000
"""About so many rows make a row group: what is read at once."""


def write(detections: Detections, path: Path) -> None:
    """Write a table, a row group a range of frames."""
    import pyarrow.parquet as pq

    schema = table_of(detections.frames(0, 0)).schema.with_metadata(metadata_of(detections))
    mean_lines = max(int(detections.offsets[-1]) * len(detections.skeleton) // max(detections.n_frames, 1), 1)
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        for start, stop in ranges(detections.n_frames, max(_LINES // mean_lines, 1)):
            table = table_of(detections.frames(start, stop)).replace_schema_metadata(schema.metadata)
            writer.write_table(table, row_group_size=max(len(table), 1))


def read(path: Path, request: Request) -> Detections:
    """Read a table: by ranges where posefuse wrote it, else whole.

    Raises:
        FileError: if the file is cut short, or a column holds something else than it should.
    """
    import pyarrow.parquet as pq

    with reading(path, "parquet file"):
        about = about_of(path, pq.read_schema(path).metadata)
        if about is None:
            check_parquet(path)
            return detections_of_table(path, pq.read_table(path), request)
        check_row_groups(path)
        index = _index(path, about)
        if index is None:
            check_parquet(path)
            whole = pq.read_table(path)
            return asked_of(detections_of_table(path, whole, Request(), about.views, about.skeleton), request, path)
        return asked_of(_stored(path, about, index), request, path)


@dataclass(frozen=True)
class _Index:
    """Who is where in the file.

    Attributes:
        frame: shape (cell,): frame numbers of the cells that are recorded, ascending with the view.
        view: shape (cell,).
        time_s: shape (cell,).
        people: shape (cell,): how many.
        group_ends: shape (row group + 1,): people before each row group.
    """

    frame: np.ndarray
    view: np.ndarray
    time_s: np.ndarray
    people: np.ndarray
    group_ends: np.ndarray


def _index(path: Path, about: About) -> _Index | None:
    """Look through the file, a row group at a time; None where somebody has put its rows in another order."""
    import pyarrow.parquet as pq

    cells: list[tuple[np.ndarray, ...]] = []
    counts, last = [0], -1
    with pq.ParquetFile(path) as file:
        for group in range(file.num_row_groups):
            found = _cells_of_group(file, group, about)
            if found is None or (len(found[0]) and found[0][0] <= last):
                return None
            cells.append(found)
            counts.append(int(found[3].sum()))
            last = int(found[0][-1]) if len(found[0]) else last
    if not cells or last < 0:
        raise FileError(f"{path} is an empty recording: it has no frames.")
    key, times, _, people = (np.concatenate(part) for part in zip(*cells, strict=True))
    frame, view = np.divmod(key, len(about.views))
    return _Index(frame, view, times, people, np.cumsum(counts))


def _cells_of_group(file: Any, group: int, about: About) -> tuple[np.ndarray, ...] | None:
    """Of each view and frame of a row group, in order: its key, time, first line and number of people."""
    table = file.read_row_group(group, columns=["camera", "frame", "time_s", "keypoint"])
    view = _places(table["camera"], about.views)
    part = _places(table["keypoint"], about.skeleton.keypoints)
    key = table["frame"].to_numpy() * len(about.views) + view
    there = part >= 0
    n_keypoints = len(about.skeleton)
    in_order = (
        len(part[there]) % n_keypoints == 0 and (part[there].reshape(-1, n_keypoints) == np.arange(n_keypoints)).all()
    )
    blocks = key[there].reshape(-1, n_keypoints) if in_order else key[:0].reshape(0, 1)
    if not in_order or (view < 0).any() or (np.diff(key) < 0).any() or (blocks != blocks[:, :1]).any():
        return None
    keys, first, lines = np.unique(key, return_index=True, return_counts=True)
    alone = ~there[first]
    if (alone & (lines > 1)).any():
        return None
    time_s = table["time_s"].to_numpy()[first].astype(np.float64)
    return keys, time_s, first, np.where(alone, 0, lines // n_keypoints)


def _places(column: Any, names: Sequence[str]) -> np.ndarray:
    """Which of the names each cell is, -1 for none."""
    import pyarrow as pa
    from pyarrow.compute import SetLookupOptions, call_function

    options = SetLookupOptions(pa.array(list(names), pa.string()))
    return call_function("index_in", [column.cast(pa.string())], options).fill_null(-1).to_numpy()


def _stored(path: Path, about: About, index: _Index) -> Detections:
    numbers = line_of_frames(path, index.frame, own=True)
    shape = len(numbers), len(about.views)
    recorded, times, people = np.zeros(shape, dtype=bool), np.full(shape, np.nan), np.zeros(shape, dtype=np.int64)
    cells = np.searchsorted(numbers, index.frame), index.view
    recorded[cells], times[cells], people[cells] = True, index.time_s, index.people
    columns = column_names(path)

    def stored(*names: str) -> "_Stored | None":
        return _Stored(path, names, index.group_ends, len(about.skeleton)) if names[0] in columns else None

    pixels, confidence = stored("x_px", "y_px"), stored("confidence")
    assert pixels is not None
    assert confidence is not None
    return Detections(
        skeleton=about.skeleton,
        view_names=about.views,
        frame_numbers=numbers,
        time_s=times,
        offsets=np.concatenate([[0], np.cumsum(people)]),
        keypoints_px=pixels,
        confidence=confidence,
        recorded=recorded,
        track_ids=_Tracks(path, index.group_ends, len(about.skeleton)),
        depth=stored("depth"),
        sigma_px=stored("sigma_px"),
        rate_hz=about.rate_hz,
        notes=about.notes,
    )


class _Stored(RowsByRange):
    """Columns of the file; it is open only while it is read."""

    def __init__(self, path: Path, names: tuple[str, ...], group_ends: np.ndarray, n_keypoints: int) -> None:
        super().__init__((int(group_ends[-1]), n_keypoints, *((len(names),) if len(names) > 1 else ())))
        self._path, self._names, self._ends = path, names, group_ends

    def rows(self, start: int, stop: int) -> np.ndarray:
        """Of the row groups that they lie in."""
        return np.concatenate(list(self._parts(start, stop)))

    def _parts(self, start: int, stop: int) -> Iterator[np.ndarray]:
        import pyarrow.parquet as pq

        first = int(np.searchsorted(self._ends, start, side="right")) - 1
        with reading(self._path, "parquet file"), pq.ParquetFile(self._path) as file:
            for group in range(first, len(self._ends) - 1):
                begin, end = int(self._ends[group]), int(self._ends[group + 1])
                if begin >= stop:
                    return
                if end > begin:
                    yield self._group(file, group)[max(start - begin, 0) : stop - begin]

    def _group(self, file: Any, group: int) -> np.ndarray:
        """A row group's people."""
        table = file.read_row_group(group, columns=[*self._names, "keypoint"])
        there = table["keypoint"].is_valid().to_numpy()
        values = [table[name].to_numpy()[there].astype(np.float64) for name in self._names]
        return np.stack(values, axis=-1).reshape(-1, *self.shape[1:])


class _Tracks(_Stored):
    """The track of each person."""

    def __init__(self, path: Path, group_ends: np.ndarray, n_keypoints: int) -> None:
        super().__init__(path, ("track",), group_ends, n_keypoints)
        self.shape, self.dtype, self._n_keypoints = (int(group_ends[-1]),), np.dtype(np.int64), n_keypoints

    def _group(self, file: Any, group: int) -> np.ndarray:
        table = file.read_row_group(group, columns=["track", "keypoint"])
        there = table["keypoint"].is_valid().to_numpy()
        tracks = table["track"].fill_null(-1).to_numpy()
        return tracks[there][:: self._n_keypoints].astype(np.int64)
