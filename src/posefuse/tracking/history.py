"""What a tracker knew of everybody in every frame, kept in little memory, to be gone through again afterwards."""

import os
import pickle
import tempfile
import weakref
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.keeping import Spool
from posefuse.kernels.articulated import State, predict_people
from posefuse.model.tracks import TrackState
from posefuse.tracking.bodies import chosen, seen_at, uncertain
from posefuse.tracking.parts import PartFollower
from posefuse.tracking.records import People, Person, Remembered, Track
from posefuse.tracking.settings import Settings
from posefuse.tracking.tracker import ArticulatedTracker

_BLOCK_S = 5.0
_AT_HAND = 4


@dataclass(frozen=True, eq=False)
class Run:
    """One person in frames that follow each other without a gap, as the filter knew them.

    Attributes:
        number: of the one who was followed, whatever they are called.
        places: shape (frame,), int64: which frames of the history, counted from 0.
        time_s: shape (frame,).
        fresh: whether the filter began anew with the first frame.
        state: a State with frames where people stand.
        rows: shape (frame, view), int64: the detections that are theirs, -1 for none.
        used: shape (frame, view, keypoint), bool: the keypoints that counted.
        life: shape (frame,), int8: TENTATIVE before they were believed, ACTIVE or LOST.
        missing_s: shape (frame,): for how long nothing had supported them.
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

    def __len__(self) -> int:
        return len(self.places)

    def frames(self, start: int, stop: int) -> "Run":
        """The frames ``start`` to ``stop`` of the run."""
        to = slice(start, stop)
        return Run(
            self.number, self.places[to], self.time_s[to], self.fresh and start == 0,
            State(*(s[to] for s in self.state)), self.rows[to], self.used[to], self.life[to], self.missing_s[to],
        )  # fmt: skip

    def within(self, start: int, stop: int) -> "Run":
        """The frames from ``start`` to ``stop`` of the history."""
        first, last = np.searchsorted(self.places, (start, stop))
        return self.frames(int(first), int(last))


@dataclass(frozen=True, eq=False)
class _Entry:
    """One person in one frame; of the covariance its lower triangle, without the shape's rows where that is kept."""

    place: int
    fresh: bool
    mean: tuple[np.ndarray, ...]
    triangle: np.ndarray
    rows: np.ndarray
    used: np.ndarray
    life: TrackState
    missing_s: float


@dataclass(eq=False)
class _Block:
    """Some seconds of entries, by number and place; in a spool, at some place, once nothing is added any more."""

    first: int
    entries: dict[int, dict[int, _Entry]] = field(default_factory=dict)
    spooled_at: int | None = None

    def spool(self, spool: Spool) -> None:
        """Put the entries there."""
        self.spooled_at, self.entries = spool.add(self.entries), {}


class _TemporarySpool:
    """A temporary file without a name, which is gone when this is; see :class:`posefuse.keeping.Spool`."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile(prefix="posefuse-")  # noqa: SIM115 (open as long as the history is)
        weakref.finalize(self, self._file.close)

    def add(self, value: Any) -> int:
        """Take a value; where in the file it begins."""
        place = self._file.seek(0, os.SEEK_END)
        pickle.dump(value, self._file, protocol=pickle.HIGHEST_PROTOCOL)
        return place

    def read(self, place: int) -> Any:
        """The value that begins there."""
        self._file.seek(place)
        return pickle.load(self._file)


class History:
    """Records a tracker's frames, and gives them back by ranges.

    Frames are counted from 0 in the order they were added. What is older than a few seconds lies in a spool: of a body
    of 20 keypoints 14 kB a person and frame, 1.2 GB an hour at 25 fps.

    Args:
        settings: of the tracker.
        spool: where; a temporary file without a name, which is gone when the history is, where it is left out.
    """

    def __init__(self, settings: Settings, spool: Spool | None = None) -> None:
        self.settings = settings
        self.numbers: list[int] = []
        self.time_s: list[float] = []
        self._blocks: list[_Block] = []
        self._recent: dict[int, dict[int, dict[int, _Entry]]] = {}
        self._spool = spool or _TemporarySpool()

    def __getstate__(self) -> dict[str, Any]:
        """All but what lies in the spool: whoever goes on from a pickle says where that is, with :meth:`goes_on_in`."""
        return {name: value for name, value in vars(self).items() if name not in ("_spool", "_recent")}

    def goes_on_in(self, spool: Spool) -> None:
        """Take a spool, that of the history which this one is a pickle of, for one's own."""
        self._spool, self._recent = spool, {}

    def __len__(self) -> int:
        return len(self.numbers)

    def add(self, tracker: ArticulatedTracker, people: People) -> None:
        """What a tracker knows after a frame, and the frames before it of those who are new.

        Raises:
            DetectionsError: if the frame is not later than the last.
        """
        here = self._next(people.number, people.time_s)
        told = {person.name: person for person in people.people}
        for p, track in enumerate(tracker.tracks):
            past = tracker.remembered.get(track.name)
            fresh = past is not None
            if past:
                fresh = not self._add_past(track.number, past, here)
            self._put(track.number, _entry(here, fresh, seen_at(tracker.state, p), told[track.name]))

    def add_parts(self, follower: PartFollower, tracks: list[Track], people: People) -> None:
        """What is known of everybody's part after a frame; the history is one of that part.

        Raises:
            DetectionsError: if the frame is not later than the last.
        """
        here = self._next(people.number, people.time_s)
        numbers = {track.name: track.number for track in tracks}
        for p, (part, person) in enumerate(zip(follower.tracks, follower.people, strict=True)):
            self._put(numbers[part.name], _entry(here, part.fresh, seen_at(follower.state, p), person))

    def _next(self, number: int, time_s: float) -> int:
        """Which frame, counted from 0, the one of that number will be."""
        if self.numbers and number <= self.numbers[-1]:
            raise DetectionsError(
                f"Frame {number} comes after frame {self.numbers[-1]}; a history takes frames in order."
            )
        self.numbers.append(number)
        self.time_s.append(time_s)
        here = len(self.numbers) - 1
        if not self._blocks or time_s - self.time_s[self._blocks[-1].first] >= _BLOCK_S:
            self._blocks.append(_Block(here))
            # A block stays open for another one, since people are believed some time after they were first seen.
            if len(self._blocks) > 2 and self._blocks[-3].spooled_at is None:
                self._blocks[-3].spool(self._spool)
        return here

    def _add_past(self, number: int, past: list[Remembered], here: int) -> bool:
        """Put states from before somebody was believed where they belong; whether there are any.

        In frames between them that showed nothing the body moves on as it would.
        """
        s = self.settings
        earliest = self._blocks[-2].first if len(self._blocks) > 1 else self._blocks[-1].first
        by_place = {self.place(each.number): each for each in past}
        by_place = {place: each for place, each in by_place.items() if place >= earliest}
        if not by_place:
            return False
        state, seen_s = chosen(by_place[min(by_place)].state, [0]), 0.0
        views, keypoints = len(s.rig), len(s.skeleton)
        for place in range(min(by_place), here):
            each = by_place.get(place)
            if each is not None:
                state, seen_s = chosen(each.state, [0]), self.time_s[place]
                rows, used = each.rows, np.tile(each.rows[:, None] >= 0, (1, keypoints))
            else:
                dt_s = np.array([self.time_s[place] - self.time_s[place - 1]])
                predict_people(dt_s, s.decay_s, s.power, s.most, s.options.motion.shape_walk, state)
                rows, used = np.full(views, -1), np.zeros((views, keypoints), dtype=bool)
            missing_s = self.time_s[place] - seen_s
            self._put(
                number,
                _Entry(
                    place, place == min(by_place), *_packed(state), rows, used, TrackState.TENTATIVE, missing_s
                ),
            )  # fmt: skip
        return True

    def _put(self, number: int, entry: _Entry) -> None:
        block = next(block for block in reversed(self._blocks) if block.first <= entry.place)
        block.entries.setdefault(number, {})[entry.place] = entry

    def place(self, number: int) -> int:
        """Which frame, counted from 0, has a number.

        Raises:
            DetectionsError: if none has.
        """
        place = bisect_left(self.numbers, number)
        if place == len(self.numbers) or self.numbers[place] != number:
            raise DetectionsError(f"The history has no frame {number}.")
        return place

    def place_at(self, time_s: float) -> int:
        """The first frame, counted from 0, that is later than a time."""
        return bisect_right(self.time_s, time_s)

    def runs(self, start: int, stop: int) -> list[Run]:
        """Everybody in the frames ``start`` to ``stop``, counted from 0; by number, then by time.

        A person has several runs where they were not followed in between, or where the filter began anew.
        """
        found: dict[int, list[_Entry]] = {}
        ends = [*(block.first for block in self._blocks[1:]), len(self.numbers)]
        for block, end in zip(self._blocks, ends, strict=True):
            if block.first < stop and end > start:
                for number, entries in self._entries(block).items():
                    inside = (entries[place] for place in sorted(entries) if start <= place < stop)
                    found.setdefault(number, []).extend(inside)
        return [self._run(number, part) for number, entries in found.items() for part in _unbroken(entries)]

    def _entries(self, block: _Block) -> dict[int, dict[int, _Entry]]:
        """Of a block; those of the last few that were read from files are at hand."""
        if block.spooled_at is None:
            return block.entries
        if block.first not in self._recent:
            while len(self._recent) >= _AT_HAND:
                del self._recent[next(iter(self._recent))]
            self._recent[block.first] = self._spool.read(block.spooled_at)
        return self._recent[block.first]

    def _run(self, number: int, entries: list[_Entry]) -> Run:
        places = np.array([entry.place for entry in entries])
        return Run(
            number,
            places,
            np.array([self.time_s[place] for place in places]),
            entries[0].fresh,
            _unpacked(entries),
            np.stack([entry.rows for entry in entries]),
            np.stack([entry.used for entry in entries]),
            np.array([entry.life for entry in entries], dtype=np.int8),
            np.array([entry.missing_s for entry in entries]),
        )


def _entry(place: int, fresh: bool, state: State, person: Person) -> _Entry:
    return _Entry(place, fresh, *_packed(state), person.rows, person.used, person.state, person.missing_s)


def _unbroken(entries: list[_Entry]) -> Iterator[list[_Entry]]:
    """Parts in which each frame follows the one before and goes on from it."""
    first = 0
    for i in range(1, len(entries) + 1):
        if i == len(entries) or entries[i].fresh or entries[i].place != entries[i - 1].place + 1:
            yield entries[first:i]
            first = i


@cache
def _triangle(n_pose: int, n_shape: int, free: bool) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the lower triangle of what is not known for certain."""
    rows = uncertain(n_pose, n_shape, free)
    low, high = np.tril_indices(len(rows))
    return rows[low], rows[high]


def _packed(state: State) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    triangle = state.covariance[0][_triangle(state.velocity.shape[1], state.shape.shape[1], bool(state.free[0]))]
    mean = (state.root[0], state.turns[0], state.bones[0], state.shape[0], state.velocity[0], state.free[0])
    return tuple(np.array(each) for each in mean), triangle


def _unpacked(entries: list[_Entry]) -> State:
    root, turns, bones, shape, velocity, free = (
        np.stack(each) for each in zip(*(e.mean for e in entries), strict=True)
    )
    n, h = velocity.shape[1], shape.shape[1]
    state = State(root, turns, bones, shape, velocity, np.zeros((len(entries), 2 * n + h, 2 * n + h)), free)
    for k, entry in enumerate(entries):
        low, high = _triangle(n, h, bool(free[k]))
        state.covariance[k][low, high] = entry.triangle
        state.covariance[k][high, low] = entry.triangle
    return state
