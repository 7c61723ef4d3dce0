"""Who is where in parquet tables of a row a camera and frame, and their numbers read by ranges of people."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import reading
from posefuse.io.keypoints.lazy_columns import RowsByRange
from posefuse.io.parquet_files import check_row_groups


@dataclass(frozen=True)
class Index:
    """Rows of tables in the order of :class:`Detections`: by frame, then view.

    Attributes:
        files: the tables.
        frame: shape (cell,), int64: frame number of each row.
        view: shape (cell,).
        people: shape (cell,): how many are in it.
        time_s: shape (cell,), or None where the tables give no times.
        file_of: shape (person,): which table each person is in.
        place_of: shape (person,): which of its people.
        group_ends: of each table, shape (row group + 1,): people before each row group.
        n_keypoints: of each person; 0 where there is nobody.
    """

    files: tuple[Path, ...]
    frame: np.ndarray
    view: np.ndarray
    people: np.ndarray
    time_s: np.ndarray | None
    file_of: np.ndarray
    place_of: np.ndarray
    group_ends: tuple[np.ndarray, ...]
    n_keypoints: int


@dataclass(frozen=True)
class _Table:
    """The rows of one table in its own order; ``camera`` codes ``names``, or is 0 where it is of one camera."""

    frame: np.ndarray
    time_s: np.ndarray | None
    camera: np.ndarray
    people: np.ndarray
    group_ends: np.ndarray
    n_keypoints: int


def index_files(files: Sequence[Path], names: Sequence[str], columns: dict[str, str]) -> tuple[tuple[str, ...], Index]:
    """Look through tables, a row group at a time.

    Args:
        files: the tables.
        names: of the camera of each; of tables with a column of cameras that does not count.
        columns: what the columns are called.

    Returns:
        The cameras' names in order, and the index.

    Raises:
        FileError: if a camera has a frame twice, or people have different numbers of keypoints.
    """
    views: list[str] = [] if "camera" in columns else list(dict.fromkeys(names))
    tables = []
    for file, name in zip(files, names, strict=True):
        with reading(file, "parquet table"):
            tables.append(_look_through(file, name, views, columns))
    lengths = sorted({table.n_keypoints for table in tables if table.n_keypoints})
    if len(lengths) > 1:
        raise FileError(f"{files[0].parent}: people have {lengths} keypoints; one recording has one skeleton.")
    frame, view, people = (np.concatenate([getattr(t, n) for t in tables]) for n in ("frame", "camera", "people"))
    order = np.lexsort((view, frame))
    frame, view = frame[order], view[order]
    twice = (np.diff(frame) == 0) & (np.diff(view) == 0)
    if twice.any():
        at = int(np.argmax(twice))
        raise FileError(
            f"{files[0].parent}: camera {views[view[at]]!r} has two rows of frame {frame[at]}. "
            "Are there several recordings? Give the folder of one."
        )
    first = np.concatenate([np.cumsum(table.people) - table.people for table in tables])[order]
    table_of = np.repeat(np.arange(len(tables), dtype=np.int32), [len(table.frame) for table in tables])[order]
    people = people[order]
    starts = np.cumsum(people) - people
    return tuple(views), Index(
        tuple(files), frame, view, people, _times(tables, order),
        np.repeat(table_of, people), np.repeat(first - starts, people) + np.arange(int(people.sum())),
        tuple(table.group_ends for table in tables), lengths[0] if lengths else 0,
    )  # fmt: skip


def reordered(index: Index, places: np.ndarray) -> Index:
    """The index with views in another order: ``places`` says where each goes. Rows keep theirs within a frame's view.

    Frames' rows are put in the order of the views.
    """
    view = places[index.view]
    order = np.lexsort((view, index.frame))
    starts = np.cumsum(index.people) - index.people
    people = index.people[order]
    fresh = np.cumsum(people) - people
    rows = np.repeat(starts[order] - fresh, people) + np.arange(int(people.sum()))
    return replace(
        index,
        frame=index.frame[order],
        view=view[order],
        people=people,
        time_s=None if index.time_s is None else index.time_s[order],
        file_of=index.file_of[rows],
        place_of=index.place_of[rows],
    )


def _times(tables: Sequence[_Table], order: np.ndarray) -> np.ndarray | None:
    if any(table.time_s is None for table in tables):
        return None
    times = np.concatenate([table.time_s for table in tables if table.time_s is not None])[order]
    return times if np.isfinite(times).any() else None


def _look_through(file: Path, name: str, views: list[str], columns: dict[str, str]) -> _Table:
    import pyarrow.parquet as pq

    length = columns.get("scores", columns["kps"])
    wanted = [columns[kind] for kind in ("frame", "time", "camera") if kind in columns] + [length]
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
    counts, n_keypoints = [0], 0
    check_row_groups(file)
    with pq.ParquetFile(file) as content:
        for group in range(content.num_row_groups):
            table = content.read_row_group(group, columns=wanted)
            people, k = _lengths(file, table[length])
            n_keypoints = n_keypoints or k
            if k and k != n_keypoints:
                raise FileError(f"{file}: people have {n_keypoints} and {k} keypoints; one recording has one skeleton.")
            counts.append(int(people.sum()))
            parts.append((_frames(file, table[columns["frame"]]), _seconds(table, columns), people,
                          _cameras(file, table, name, views, columns)))  # fmt: skip
    if not parts:
        raise FileError(f"{file} has no rows. Is the file truncated?")
    frame, time_s, people, camera = (np.concatenate(part) for part in zip(*parts, strict=True))
    return _Table(frame, time_s if "time" in columns else None, camera, people, np.cumsum(counts), n_keypoints)


def _lengths(file: Path, column: Any) -> tuple[np.ndarray, int]:
    """People in each row, and keypoints of each person."""
    from pyarrow.compute import call_function

    whole = column.combine_chunks()
    people = call_function("list_value_length", [whole]).fill_null(0).to_numpy(zero_copy_only=False)
    inner = call_function("list_value_length", [whole.flatten()])
    known = np.unique(inner.to_numpy(zero_copy_only=False))
    if len(known) > 1 or inner.null_count:
        raise FileError(f"{file}: people have {known.tolist()} keypoints; one recording has one skeleton.")
    return people.astype(np.int64), int(known[0]) if len(known) else 0


def _frames(file: Path, column: Any) -> np.ndarray:
    values = column.to_numpy().astype(np.float64)
    bad = ~(np.abs(values) < 2**40) | (values != np.round(values))
    if bad.any():
        raise FileError(f"{file}: a frame number should be a whole number, got {values[int(np.argmax(bad))]}.")
    return values.astype(np.int64)


def _seconds(table: Any, columns: dict[str, str]) -> np.ndarray:
    if "time" not in columns:
        return np.full(len(table), np.nan)
    column = table[columns["time"]]
    if columns["time"] == "timestamp_ns":
        # Nanoseconds of the clock are more than a float can tell apart; those of a day are not.
        whole = column.fill_null(0).to_numpy().astype(np.int64)
        return np.where(column.is_valid().to_numpy(), whole * 1e-9, np.nan)
    return column.to_numpy().astype(np.float64)


def _cameras(file: Path, table: Any, name: str, views: list[str], columns: dict[str, str]) -> np.ndarray:
    """Which view each row is of; views that are new are added."""
    if "camera" not in columns:
        return np.full(len(table), views.index(name))
    names = [str(value) for value in table[columns["camera"]].to_pylist()]
    for new in dict.fromkeys(names):
        if new not in views:
            views.append(new)
    return np.array([views.index(value) for value in names], dtype=np.int64)


class _PersonRows(RowsByRange):
    """A column of lists, a row a person."""

    def __init__(self, index: Index, column: str | None, shape: tuple[int, ...], dtype: type = np.float64) -> None:
        super().__init__((len(index.place_of), *shape), dtype)
        self._index, self._column = index, column

    def rows(self, start: int, stop: int) -> np.ndarray:
        """Of all tables that they lie in."""
        index = self._index
        files, places = index.file_of[start:stop], index.place_of[start:stop]
        out = np.full((stop - start, *self.shape[1:]), -1 if self.dtype.kind == "i" else np.nan, dtype=self.dtype)
        if self._column is None:
            return out
        for f in np.unique(files):
            mine = np.flatnonzero(files == f)
            for first, values in self._groups(int(f), places[mine]):
                here = mine[(places[mine] >= first) & (places[mine] < first + len(values))]
                out[here] = values[places[here] - first]
        return out

    def _groups(self, f: int, places: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """The row groups that hold those people, each with the place of its first."""
        import pyarrow.parquet as pq

        ends, file = self._index.group_ends[f], self._index.files[f]
        wanted = np.unique(np.searchsorted(ends, places, side="right") - 1)
        with reading(file, "parquet table"), pq.ParquetFile(file) as content:
            for group in wanted.tolist():
                column = content.read_row_group(group, columns=[self._column])[self._column].combine_chunks()
                values = self._values(column)
                if len(values) != ends[group + 1] - ends[group]:
                    raise FileError(
                        f"{file}: {self._column} has {len(values)} people where others have another number."
                    )
                yield int(ends[group]), values

    def _values(self, column: Any) -> np.ndarray:
        """The numbers of a row group's people."""
        raise NotImplementedError


class NumberRows(_PersonRows):
    """Pixels, confidences, or other numbers of keypoints.

    Args:
        index: of the tables.
        column: its name.
        channels: which numbers of each keypoint; none where the column has one number a keypoint.
        blank: whether a keypoint at 0, 0 is missing.
    """

    def __init__(self, index: Index, column: str, channels: Sequence[int] = (), *, blank: bool = False) -> None:
        depth = (len(channels),) if len(channels) > 1 else ()
        super().__init__(index, column, (index.n_keypoints, *depth))
        self._channels, self._blank = list(channels), blank

    def _values(self, column: Any) -> np.ndarray:
        people = column.flatten()
        keypoints = people.flatten()
        numbers = keypoints.flatten() if self._channels else keypoints
        flat = numbers.to_numpy(zero_copy_only=False).astype(np.float64)
        values = flat.reshape(len(people), self._index.n_keypoints, *((-1,) if self._channels else ()))
        if self._channels:
            if values.shape[-1] <= max(self._channels):
                return np.full((len(people), *self.shape[1:]), np.nan)
            values = values[..., self._channels].reshape(len(people), *self.shape[1:])
        if self._blank:
            values = np.where((values == 0.0).all(axis=-1, keepdims=True), np.nan, values)
        if len(self.shape) == 3:
            values = np.where(np.isfinite(values).all(axis=-1, keepdims=True), values, np.nan)
        return np.where(np.isinf(values), np.nan, values)


class TrackRows(_PersonRows):
    """The detector's identities; -1 where the tables have none."""

    def __init__(self, index: Index, column: str | None) -> None:
        super().__init__(index, column, (), np.int64)

    def _values(self, column: Any) -> np.ndarray:
        return column.flatten().fill_null(-1).to_numpy(zero_copy_only=False).astype(np.int64)
