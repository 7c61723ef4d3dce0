"""What a tracker knew of everybody in every frame, kept in little memory, to be gone through again afterwards."""

import os
import pickle
import sys
import tempfile
import weakref
from array import array
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from posefuse.checkpoint import Spool
from posefuse.errors import DetectionsError
from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.records import State
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import chosen
from posefuse.tracking.history_entries import Entries
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


@dataclass(eq=False)
class _Block:
    """Some seconds of entries, by number and place; in a spool, at some place, once nothing is added any more."""

    first: int
    entries: dict[int, dict[int, Entries]] = field(default_factory=dict)
    spooled_at: int | None = None

    def joined(self, start: int, stop: int) -> dict[int, Entries]:
        """Everybody in the frames from ``start`` to ``stop`` of the history, by number, of a block in no spool."""
        found = {
            number: [entries[place] for place in sorted(entries) if start <= place < stop]
            for number, entries in self.entries.items()
        }
        return {number: Entries.joined(parts) for number, parts in found.items() if parts}

    def spool(self, spool: Spool) -> None:
        """Put the entries there."""
        self.spooled_at, self.entries = spool.add(self.joined(0, sys.maxsize)), {}


class _TemporarySpool:
    """A temporary file without a name, which is gone when this is; see :class:`posefuse.checkpoint.Spool`."""

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
        self.numbers = array("q")
        self.time_s = array("d")
        self._blocks: list[_Block] = []
        self._recent: dict[int, dict[int, Entries]] = {}
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
            self._put(track.number, _entry(here, fresh, tracker.state, p, told[track.name]))

    def add_parts(self, follower: PartFollower, tracks: list[Track], people: People) -> None:
        """What is known of everybody's part after a frame; the history is one of that part.

        Raises:
            DetectionsError: if the frame is not later than the last.
        """
        here = self._next(people.number, people.time_s)
        numbers = {track.name: track.number for track in tracks}
        for p, (part, person) in enumerate(zip(follower.tracks, follower.people, strict=True)):
            self._put(numbers[part.name], _entry(here, part.fresh, follower.state, p, person))

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
                Entries.one(place, place == min(by_place), state, rows, used, TrackState.TENTATIVE, missing_s),
            )
        return True

    def _put(self, number: int, entry: Entries) -> None:
        place = int(entry.places[0])
        block = next(block for block in reversed(self._blocks) if block.first <= place)
        block.entries.setdefault(number, {})[place] = entry

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
        found: dict[int, list[Entries]] = {}
        ends = [*(block.first for block in self._blocks[1:]), len(self.numbers)]
        for block, end in zip(self._blocks, ends, strict=True):
            if block.first < stop and end > start:
                for number, entries in self._entries(block, start, stop).items():
                    found.setdefault(number, []).append(entries)
        return [self._run(number, part) for number, parts in found.items() for part in Entries.joined(parts).unbroken()]

    def _entries(self, block: _Block, start: int, stop: int) -> dict[int, Entries]:
        """Of some frames of a block, by number; those of the last few that were read from files are at hand."""
        if block.spooled_at is None:
            return block.joined(start, stop)
        if block.first not in self._recent:
            while len(self._recent) >= _AT_HAND:
                del self._recent[next(iter(self._recent))]
            self._recent[block.first] = self._spool.read(block.spooled_at)
        inside = {number: entries.within(start, stop) for number, entries in self._recent[block.first].items()}
        return {number: entries for number, entries in inside.items() if len(entries)}

    def _run(self, number: int, entries: Entries) -> Run:
        places = entries.places
        return Run(
            number, places, np.array(self.time_s[places[0] : places[-1] + 1]), bool(entries.fresh[0]), entries.state,
            entries.rows, entries.used, entries.life, entries.missing_s,
        )  # fmt: skip


def _entry(place: int, fresh: bool, states: State, p: int, person: Person) -> Entries:
    """A frame of somebody."""
    state = State(*(each[p : p + 1] for each in states))
    return Entries.one(place, fresh, state, person.rows, person.used, person.state, person.missing_s)
