"""Compact storage of the states of tracks in a history."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np

from posefuse.kernels.linear_algebra.triangles import unpack_triangles
from posefuse.kernels.tracking.history_rows import HistoryRows, RowHeads, SeenPeople, write_rows
from posefuse.kernels.tracking.records import State

_FIRST_ROWS = 64


@dataclass(frozen=True, eq=False)
class Entries:
    """States of one track in some frames, in order.

    Attributes:
        places: shape (frame,), int64: indices of the frames in the history.
        fresh: shape (frame,), bool: whether the filter was initialized in the frame.
        rows: shape (frame, view), int64: assigned detections, -1 for none.
        used: shape (frame, view, keypoint), bool: keypoints that the update used.
        life: shape (frame,), int8: :class:`TrackState`.
        missing_s: shape (frame,): time since the last support, in seconds.
        keypoints_px: shape (frame, view, node keypoint, 2), float32: assigned keypoints of the body, NaN where there is
            none.
        confidence: shape (frame, view, node keypoint), float32.
        root: shape (frame, 3); this and the following fields are those of the State.
        turns: shape (frame, segment, 3, 3).
        bones: shape (frame, bone, 3, 3).
        shape: shape (frame, shape).
        velocity: shape (frame, pose).
        free: shape (frame,), int64.
        triangles: shape (number,): lower triangles of the covariances, without the rows of a fixed shape, rounded to 33
            binary digits: further ones do not compress.
    """

    places: np.ndarray
    fresh: np.ndarray
    rows: np.ndarray
    used: np.ndarray
    life: np.ndarray
    missing_s: np.ndarray
    keypoints_px: np.ndarray
    confidence: np.ndarray
    root: np.ndarray
    turns: np.ndarray
    bones: np.ndarray
    shape: np.ndarray
    velocity: np.ndarray
    free: np.ndarray
    triangles: np.ndarray

    def __len__(self) -> int:
        return len(self.places)

    @classmethod
    def joined(cls, parts: Sequence["Entries"]) -> "Entries":
        """Return consecutive entries as one."""
        if len(parts) == 1:
            return parts[0]
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))

    def frames(self, start: int, stop: int) -> "Entries":
        """Return the frames ``start`` to ``stop`` of these."""
        n, h = self.velocity.shape[1], self.shape.shape[1]
        size = np.where(self.free != 0, 2 * n + h, 2 * n)
        ends = np.concatenate([[0], np.cumsum(size * (size + 1) // 2)])
        cut = {field.name: getattr(self, field.name)[start:stop] for field in fields(self)}
        cut["triangles"] = self.triangles[ends[start] : ends[stop]]
        return Entries(**cut)

    def within(self, start: int, stop: int) -> "Entries":
        """Return the frames from ``start`` to ``stop`` of the history."""
        first, last = np.searchsorted(self.places, (start, stop))
        return self.frames(int(first), int(last))

    def unbroken(self) -> list["Entries"]:
        """Return the parts in which every frame continues the one before."""
        begins = np.flatnonzero(self.fresh[1:] | (np.diff(self.places) != 1)) + 1
        edges = [0, *begins.tolist(), len(self)]
        return [self.frames(first, last) for first, last in pairwise(edges)]

    @property
    def state(self) -> State:
        """State with one entry per frame instead of per person."""
        n, h = self.velocity.shape[1], self.shape.shape[1]
        covariance = np.empty((len(self), 2 * n + h, 2 * n + h))
        unpack_triangles(self.triangles, self.free, n, h, covariance)
        return State(self.root, self.turns, self.bones, self.shape, self.velocity, covariance, self.free)


class EntryTable:
    """Entries of several tracks, in the order in which they were added."""

    def __init__(self) -> None:
        self._rows: HistoryRows | None = None
        self._count = 0

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without unused rows."""
        return {"_rows": None if self._rows is None else self._written, "_count": self._count}

    def __len__(self) -> int:
        return self._count

    @property
    def _written(self) -> HistoryRows:
        assert self._rows is not None
        return HistoryRows(*(each[: self._count] for each in self._rows))

    def add(self, heads: RowHeads, state: State, seen: SeenPeople) -> None:
        """Add the entries of some people in one frame; they replace earlier entries of the same tracks and frame."""
        first, count = self._count, self._count + len(heads.number)
        if self._rows is None:
            self._rows = _empty_rows(max(_FIRST_ROWS, count), state, seen)
        elif count > len(self._rows.number):
            grown = _empty_rows(2 * count, state, seen)
            for new, old in zip(grown, self._written, strict=True):
                new[:first] = old
            self._rows = grown
        write_rows(first, heads, state, seen, self._rows)
        self._count = count

    def by_track(self, start: int, stop: int) -> dict[int, Entries]:
        """Return the entries of the frames ``start`` to ``stop`` by track number, in the order of their first entry."""
        if self._rows is None:
            return {}
        written = self._written
        inside = (written.places >= start) & (written.places < stop)
        found = {}
        for number in dict.fromkeys(written.number.tolist()):
            own = np.flatnonzero(inside & (written.number == number))
            if len(own):
                found[number] = _entries_of(written, _latest(own, written.places[own]))
        return found


def _empty_rows(count: int, state: State, seen: SeenPeople) -> HistoryRows:
    """Return rows to be written, of the shapes that a state and the views determine."""
    (views, keypoints), own, size = seen.used.shape[1:], len(seen.node_keypoints), state.covariance.shape[1]
    return HistoryRows(
        number=np.empty(count, dtype=np.int64),
        places=np.empty(count, dtype=np.int64),
        fresh=np.empty(count, dtype=bool),
        rows=np.empty((count, views), dtype=np.int64),
        used=np.empty((count, views, keypoints), dtype=bool),
        life=np.empty(count, dtype=np.int8),
        missing_s=np.empty(count),
        keypoints_px=np.empty((count, views, own, 2), dtype=np.float32),
        confidence=np.empty((count, views, own), dtype=np.float32),
        root=np.empty((count, 3)),
        turns=np.empty((count, *state.turns.shape[1:])),
        bones=np.empty((count, *state.bones.shape[1:])),
        shape=np.empty((count, state.shape.shape[1])),
        velocity=np.empty((count, state.velocity.shape[1])),
        free=np.empty(count, dtype=np.int64),
        triangles=np.zeros((count, size * (size + 1) // 2)),
    )


def _latest(rows: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the last row of each frame, ordered by frame."""
    if (np.diff(places) > 0).all():
        return rows
    _, last = np.unique(places[::-1], return_index=True)
    return rows[::-1][last]


def _entries_of(written: HistoryRows, rows: np.ndarray) -> Entries:
    """Return some rows, which are those of one track, as entries."""
    free, full = written.free[rows] != 0, written.triangles.shape[1]
    size = 2 * written.velocity.shape[1]
    fixed = size * (size + 1) // 2
    if free.all():
        triangles = written.triangles[rows].ravel()
    elif not free.any():
        triangles = written.triangles[rows, :fixed].ravel()
    else:
        parts = zip(rows.tolist(), free.tolist(), strict=True)
        triangles = np.concatenate([written.triangles[row, : full if is_free else fixed] for row, is_free in parts])
    columns = {field.name: getattr(written, field.name)[rows] for field in fields(Entries) if field.name != "triangles"}
    return Entries(**columns, triangles=triangles)
