"""Index of parquet tables with one row per camera and frame, and their numbers read by ranges of people."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.arrow import import_pyarrow, numbers_in
from posefuse.io.files import reading
from posefuse.io.parquet_files import check_row_groups
from posefuse.lazy_array import LazyArray

_MAX_KEPT_BYTES, _MIN_KEPT, _MAX_KEPT = 80_000_000, 3, 256
"""Size of the last row groups of a column that stay in memory, and their number, at least and at most.

A range of frames takes one group of every table."""


@dataclass(frozen=True)
class PeopleIndex:
    """Where the people of :class:`Detections` are in the tables, in their order.

    Attributes:
        files: The tables.
        file_of: Shape (person,): index of the table that contains the person.
        place_of: Shape (person,): index of the person in that table.
        group_ends: For each table, shape (row group + 1,): number of people before each row group.
        n_keypoints: Number of keypoints per person, 0 without people.
    """

    files: tuple[Path, ...]
    file_of: np.ndarray
    place_of: np.ndarray
    group_ends: tuple[np.ndarray, ...]
    n_keypoints: int


@dataclass(frozen=True)
class Index:
    """Rows of tables in the order of :class:`Detections`: by frame, then view. A cell is a row of a table.

    Attributes:
        frame: Shape (cell,), int64: frame number.
        view: Shape (cell,): index of the view.
        people: Shape (cell,): number of people.
        time_s: Shape (cell,), or None if the tables have no times.
        places: Where the people of all cells are.
    """

    frame: np.ndarray
    view: np.ndarray
    people: np.ndarray
    time_s: np.ndarray | None
    places: PeopleIndex


@dataclass(frozen=True)
class _Table:
    """The rows of one table in file order. ``camera`` is the index of the view."""

    frame: np.ndarray
    time_s: np.ndarray | None
    camera: np.ndarray
    people: np.ndarray
    group_ends: np.ndarray
    n_keypoints: int


def index_files(files: Sequence[Path], names: Sequence[str], columns: dict[str, str]) -> tuple[tuple[str, ...], Index]:
    """Index tables one row group at a time.

    Args:
        files: The tables.
        names: Name of the camera of each table. Ignored for tables with a camera column.
        columns: Names of the columns by kind.

    Returns:
        The names of the cameras in order, and the index.

    Raises:
        FileError: If a camera has a frame twice, or people have different numbers of keypoints.
    """
    views: list[str] = [] if "camera" in columns else list(dict.fromkeys(names))
    tables = []
    for file, name in zip(files, names, strict=True):
        with reading(file, "parquet table"):
            tables.append(_index_table(file, name, views, columns))
    lengths = sorted({table.n_keypoints for table in tables if table.n_keypoints})
    if len(lengths) > 1:
        raise FileError(f"{files[0].parent}: people have {lengths} keypoints. All must have the same skeleton.")
    frame, view, people = (np.concatenate([getattr(t, n) for t in tables]) for n in ("frame", "camera", "people"))
    order = np.lexsort((view, frame))
    frame, view = frame[order], view[order]
    repeated = (np.diff(frame) == 0) & (np.diff(view) == 0)
    if repeated.any():
        at = int(np.argmax(repeated))
        raise FileError(
            f"{files[0].parent}: camera {views[view[at]]!r} has two rows for frame {frame[at]}. "
            "If the folder contains several recordings, specify the folder of one."
        )
    first = np.concatenate([np.cumsum(table.people) - table.people for table in tables])[order]
    table_of = np.repeat(np.arange(len(tables), dtype=np.int32), [len(table.frame) for table in tables])[order]
    people = people[order]
    starts = np.cumsum(people) - people
    places = PeopleIndex(
        tuple(files), np.repeat(table_of, people), np.repeat(first - starts, people) + np.arange(int(people.sum())),
        tuple(table.group_ends for table in tables), lengths[0] if lengths else 0,
    )  # fmt: skip
    return tuple(views), Index(frame, view, people, _times(tables, order), places)


def reordered(index: Index, positions: np.ndarray) -> Index:
    """Return an index with its views in another order.

    Args:
        index: The index.
        positions: New position of each view. The order of people within a cell is kept.
    """
    view = positions[index.view]
    order = np.lexsort((view, index.frame))
    starts = np.cumsum(index.people) - index.people
    people = index.people[order]
    new_starts = np.cumsum(people) - people
    rows = np.repeat(starts[order] - new_starts, people) + np.arange(int(people.sum()))
    time_s = None if index.time_s is None else index.time_s[order]
    places = replace(index.places, file_of=index.places.file_of[rows], place_of=index.places.place_of[rows])
    return Index(index.frame[order], view[order], people, time_s, places)


def _times(tables: Sequence[_Table], order: np.ndarray) -> np.ndarray | None:
    if any(table.time_s is None for table in tables):
        return None
    times = np.concatenate([table.time_s for table in tables if table.time_s is not None])[order]
    return times if np.isfinite(times).any() else None


def _index_table(file: Path, name: str, views: list[str], columns: dict[str, str]) -> _Table:
    pq = import_pyarrow().parquet
    length = columns.get("scores", columns["kps"])
    selected = [columns[kind] for kind in ("frame", "time", "camera") if kind in columns] + [length]
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
    counts, n_keypoints = [0], 0
    check_row_groups(file)
    with pq.ParquetFile(file) as content:
        for group in range(content.num_row_groups):
            table = content.read_row_group(group, columns=selected)
            people, k = _lengths(file, table[length])
            n_keypoints = n_keypoints or k
            if k and k != n_keypoints:
                raise FileError(
                    f"{file}: people have {n_keypoints} and {k} keypoints. All must have the same skeleton."
                )
            counts.append(int(people.sum()))
            parts.append((_frames(file, table[columns["frame"]]), _seconds(table, columns), people,
                          _cameras(file, table, name, views, columns)))  # fmt: skip
    if not parts:
        raise FileError(f"{file} has no rows. Is the file truncated?")
    frame, time_s, people, camera = (np.concatenate(part) for part in zip(*parts, strict=True))
    return _Table(frame, time_s if "time" in columns else None, camera, people, np.cumsum(counts), n_keypoints)


def _lengths(file: Path, column: Any) -> tuple[np.ndarray, int]:
    """Return the number of people in each row, and the number of keypoints per person."""
    call_function = import_pyarrow().compute.call_function
    combined = column.combine_chunks()
    people = numbers_in(call_function("list_value_length", [combined]), default=0)
    inner = call_function("list_value_length", [combined.flatten()])
    lengths = np.unique(numbers_in(inner))
    if len(lengths) > 1 or inner.null_count:
        raise FileError(f"{file}: people have {lengths.tolist()} keypoints. All must have the same skeleton.")
    return people.astype(np.int64), int(lengths[0]) if len(lengths) else 0


def _frames(file: Path, column: Any) -> np.ndarray:
    values = numbers_in(column)
    if values.dtype.kind not in "iuf":
        raise FileError(f"{file}: expected an integer for the frame number, got {column[0].as_py()!r}.")
    values = values.astype(np.float64)
    bad = ~(np.abs(values) < 2**40) | (values != np.round(values))
    if bad.any():
        raise FileError(f"{file}: expected an integer for the frame number, got {values[int(np.argmax(bad))]}.")
    return values.astype(np.int64)


def _seconds(table: Any, columns: dict[str, str]) -> np.ndarray:
    if "time" not in columns:
        return np.full(len(table), np.nan)
    column = table[columns["time"]]
    if columns["time"] == "timestamp_ns":
        # Nanoseconds since 1970 exceed the precision of float64, so they are converted as integers.
        nanoseconds = numbers_in(column, default=0).astype(np.int64)
        return np.where(column.is_valid().to_numpy(), nanoseconds * 1e-9, np.nan)
    return numbers_in(column).astype(np.float64)


def _cameras(file: Path, table: Any, name: str, views: list[str], columns: dict[str, str]) -> np.ndarray:
    """Return the index of the view of each row. New views are appended to ``views``."""
    if "camera" not in columns:
        return np.full(len(table), views.index(name))
    names = [str(value) for value in table[columns["camera"]].to_pylist()]
    for new in dict.fromkeys(names):
        if new not in views:
            views.append(new)
    return np.array([views.index(value) for value in names], dtype=np.int64)


class _PersonRows(LazyArray):
    """A column of lists, as an array with one row per person."""

    def __init__(
        self, index: PeopleIndex, column: str | None, shape: tuple[int, ...], dtype: type = np.float64
    ) -> None:
        super().__init__((len(index.place_of), *shape), dtype)
        self._index, self._column = index, column
        self._recent: dict[tuple[int, int], np.ndarray] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Return the array without the row groups in memory."""
        return {**vars(self), "_recent": {}}

    def read_rows(self, start: int, stop: int) -> np.ndarray:
        """Read the rows from the tables that contain them."""
        index = self._index
        files, places = index.file_of[start:stop], index.place_of[start:stop]
        out = np.empty((stop - start, *self.shape[1:]), dtype=self.dtype)
        if self._column is None:
            out[:] = -1 if self.dtype.kind == "i" else np.nan
            return out
        for f in np.unique(files):
            in_file = np.flatnonzero(files == f)
            for first, values in self._groups(int(f), places[in_file]):
                in_group = in_file[(places[in_file] >= first) & (places[in_file] < first + len(values))]
                out[in_group] = values[places[in_group] - first]
        return out

    def _groups(self, f: int, places: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Yield the row groups that contain these people, each with the index of its first person."""
        pq = import_pyarrow().parquet
        ends, file = self._index.group_ends[f], self._index.files[f]
        groups = np.unique(np.searchsorted(ends, places, side="right") - 1)
        recent = self._recent
        kept = {group: recent[f, group] for group in groups.tolist() if (f, group) in recent}
        if len(kept) == len(groups):
            yield from ((int(ends[group]), values) for group, values in kept.items())
            return
        with reading(file, "parquet table"), pq.ParquetFile(file) as content:
            for group in groups.tolist():
                values = kept.get(group)
                if values is None:
                    values = self._read_group(content, f, group)
                yield int(ends[group]), values

    def _read_group(self, content: Any, f: int, group: int) -> np.ndarray:
        """Return the numbers of the people of a row group; those of the last groups stay in memory."""
        ends = self._index.group_ends[f]
        column = content.read_row_group(group, columns=[self._column])[self._column].combine_chunks()
        values = self._values(column)
        if len(values) != ends[group + 1] - ends[group]:
            raise FileError(
                f"{self._index.files[f]}: {self._column} has {len(values)} people, but other columns have a different "
                "number. Is the file truncated?"
            )
        # Ranges of frames are read with those around them, and several stages read them. A new dictionary, because
        # threads may read at the same time.
        self._recent = _last_groups({**self._recent, (f, group): values})
        return values

    def _values(self, column: Any) -> np.ndarray:
        """Return the numbers of the people of a row group."""
        raise NotImplementedError


def _last_groups(groups: dict[tuple[int, int], np.ndarray]) -> dict[tuple[int, int], np.ndarray]:
    """Return the last groups that stay in memory, in the same order."""
    kept = [(key, values) for key, values in groups.items() if values.nbytes <= _MAX_KEPT_BYTES][-_MAX_KEPT:]
    size = sum(values.nbytes for _, values in kept)
    while size > _MAX_KEPT_BYTES and len(kept) > _MIN_KEPT:
        size -= kept.pop(0)[1].nbytes
    return dict(kept)


class NumberRows(_PersonRows):
    """Pixels, confidences, or other numbers of keypoints.

    Args:
        index: Where the people are in the tables.
        column: Name of the column.
        channels: Indices of the numbers of each keypoint to read. Empty if the column has one number per keypoint.
        zero_is_missing: Whether a keypoint at (0, 0) is missing.
    """

    def __init__(
        self, index: PeopleIndex, column: str, channels: Sequence[int] = (), *, zero_is_missing: bool = False
    ) -> None:
        depth = (len(channels),) if len(channels) > 1 else ()
        super().__init__(index, column, (index.n_keypoints, *depth))
        self._channels, self._zero_is_missing = list(channels), zero_is_missing

    def _values(self, column: Any) -> np.ndarray:
        people = column.flatten()
        keypoints = people.flatten()
        numbers = keypoints.flatten() if self._channels else keypoints
        flat = numbers_in(numbers).astype(np.float64)
        values = flat.reshape(len(people), self._index.n_keypoints, *((-1,) if self._channels else ()))
        if self._channels:
            if values.shape[-1] <= max(self._channels):
                return np.full((len(people), *self.shape[1:]), np.nan)
            values = values[..., self._channels].reshape(len(people), *self.shape[1:])
        if self._zero_is_missing:
            values = np.where((values == 0.0).all(axis=-1, keepdims=True), np.nan, values)
        if len(self.shape) == 3:
            values = np.where(np.isfinite(values).all(axis=-1, keepdims=True), values, np.nan)
        return np.where(np.isinf(values), np.nan, values)


class TrackRows(_PersonRows):
    """Track ids stated by the detector, -1 if the tables have none."""

    def __init__(self, index: PeopleIndex, column: str | None) -> None:
        super().__init__(index, column, (), np.int64)

    def _values(self, column: Any) -> np.ndarray:
        return numbers_in(column.flatten(), default=-1).astype(np.int64)
