"""Runs: states of one track in consecutive frames of a history."""

from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.tracking.history_entries import Entries


@dataclass(frozen=True, eq=False)
class Run:
    """Filtered states of one track in consecutive frames.

    The other fields are those of :class:`posefuse.tracking.history_entries.Entries`.

    Attributes:
        number: Number of the track, whatever its name.
        time_s: shape (frame,).
        fresh: Whether the filter was initialized with the first frame.
        state: State with one entry per frame instead of per person.
        life: shape (frame,), int8: TENTATIVE before the track was confirmed, then ACTIVE or LOST.
    """

    number: int
    places: np.ndarray
    time_s: np.ndarray
    fresh: bool
    state: State
    rows: np.ndarray
    used: np.ndarray
    life: np.ndarray
    missing_s: np.ndarray
    keypoints_px: np.ndarray
    confidence: np.ndarray

    def __len__(self) -> int:
        return len(self.places)

    def frames(self, start: int, stop: int) -> "Run":
        """Return the frames ``start`` to ``stop`` of the run."""
        to = slice(start, stop)
        return Run(
            self.number, self.places[to], self.time_s[to], self.fresh and start == 0,
            State(*(s[to] for s in self.state)), self.rows[to], self.used[to], self.life[to], self.missing_s[to],
            self.keypoints_px[to], self.confidence[to],
        )  # fmt: skip

    def within(self, start: int, stop: int) -> "Run":
        """Return the frames from ``start`` to ``stop`` of the history."""
        first, last = np.searchsorted(self.places, (start, stop))
        return self.frames(int(first), int(last))


@dataclass(frozen=True, eq=False)
class PackedRun:
    """A run as the history stores it, in a third of the memory: covariances are lower triangles.

    Attributes:
        number: Number of the track.
        time_s: shape (frame,).
        entries: Entries of the frames.
    """

    number: int
    time_s: np.ndarray
    entries: Entries

    def __len__(self) -> int:
        return len(self.time_s)

    def run(self) -> Run:
        """Return the run with its states."""
        entries = self.entries
        return Run(
            self.number, entries.places, self.time_s, bool(entries.fresh[0]), entries.state, entries.rows, entries.used,
            entries.life, entries.missing_s, entries.keypoints_px, entries.confidence,
        )  # fmt: skip

    def split_at_gaps(self, bridge_s: float) -> list["PackedRun"]:
        """Return the parts in which the person is never lost for longer than a time."""
        near = np.append(np.append(False, self.entries.missing_s <= bridge_s), False)
        edges = np.flatnonzero(near[1:] != near[:-1]).tolist()
        return [
            PackedRun(self.number, self.time_s[first:last], self.entries.frames(first, last))
            for first, last in zip(edges[::2], edges[1::2], strict=True)
        ]
