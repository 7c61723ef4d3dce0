"""History of a tracker: states of all tracks in all frames, stored compactly for the smoother."""

import os
import pickle
import tempfile
import weakref
from array import array
from bisect import bisect_left, bisect_right
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from posefuse.arrays import kernel_array
from posefuse.checkpoint import Spool
from posefuse.errors import DetectionsError
from posefuse.kernels.tracking.history_rows import RowHeads, SeenPeople
from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.records import State
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_frames import BodyFrame
from posefuse.tracking.body_states import select_states
from posefuse.tracking.history_blocks import Block
from posefuse.tracking.history_entries import Entries
from posefuse.tracking.parts import PartTracker
from posefuse.tracking.records import PastState, Person, TrackedFrame
from posefuse.tracking.runs import PackedRun, Run
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.tracker import ArticulatedTracker

_BLOCK_S = 5.0
_MAX_CACHED_BLOCKS = 2
_OTHER_BODY = 0.04
"""Median relative change of fixed lengths beyond which they are those of another body."""


@dataclass(frozen=True, eq=False)
class Epoch:
    """Frames in which the bone lengths of a track are the same.

    Attributes:
        start: Index of the first frame.
        stop: Index after the last frame.
        shape_m: shape (shape,): the lengths; None while they are estimated.
    """

    start: int
    stop: int
    shape_m: np.ndarray | None


class _TemporarySpool:
    """An anonymous temporary file that is deleted with this object; see :class:`posefuse.checkpoint.Spool`."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile(prefix="posefuse-")  # noqa: SIM115 (open as long as the history is)
        weakref.finalize(self, self._file.close)

    def add(self, value: Any) -> int:
        """Append a value and return its position in the file."""
        place = self._file.seek(0, os.SEEK_END)
        pickle.dump(value, self._file, protocol=pickle.HIGHEST_PROTOCOL)
        return place

    def read(self, place: int) -> Any:
        """Return the value at a position."""
        self._file.seek(place)
        return pickle.load(self._file)


class History:
    """Recorder of a tracker's frames, which returns ranges of them.

    Frames are counted from 0 in the order in which they were added. Entries older than a few seconds are in a spool: a
    body with 20 keypoints takes 15 kB per person and frame, or 1.4 GB per hour at 25 fps.

    Args:
        settings: Settings of the tracker.
        spool: Storage of older entries; by default an anonymous temporary file that is deleted with the history.
        thread: Thread that moves entries to the spool; by default the one that adds frames.
        has_past: Whether tracks may receive entries of frames before their first one; those of parts do not.
    """

    def __init__(
        self,
        settings: TrackerSettings,
        spool: Spool | None = None,
        thread: Executor | None = None,
        has_past: bool = True,
    ) -> None:
        self.settings = settings
        self.numbers = array("q")
        self.time_s = array("d")
        self.epochs: dict[int, list[Epoch]] = {}
        """By number of the track: ranges of frames in which its bone lengths are the same, in order."""
        self._blocks: list[Block] = []
        self._recent: dict[int, dict[int, Entries]] = {}
        # A block stays open during the next one if tracks receive entries of past frames when they are confirmed.
        self._open_blocks = 2 if has_past else 1
        self._spool, self._thread = spool or _TemporarySpool(), thread

    def __getstate__(self) -> dict[str, Any]:
        """Return everything but the spool; call :meth:`attach_spool` after unpickling."""
        self._settle()
        return {name: value for name, value in vars(self).items() if name not in ("_spool", "_thread", "_recent")}

    def attach_spool(self, spool: Spool, thread: Executor | None = None) -> None:
        """Use the spool of the history from which this one was pickled, and a thread as in the constructor."""
        self._spool, self._thread, self._recent = spool, thread, {}

    @property
    def shared_spool(self) -> Spool | None:
        """The spool to attach to a copy of this history in another process; None if no other process can read it."""
        self._settle()
        return None if isinstance(self._spool, _TemporarySpool) else self._spool

    def _settle(self) -> None:
        """Wait until the thread has moved all complete blocks to the spool."""
        for block in self._blocks:
            block.settle()

    def __len__(self) -> int:
        return len(self.numbers)

    def add(self, tracker: ArticulatedTracker, tracked: TrackedFrame) -> None:
        """Add the tracks of a frame, and earlier frames of tracks that were just confirmed.

        Args:
            tracker: The tracker after the frame.
            tracked: What it found in the frame.

        Raises:
            DetectionsError: If the frame is not later than the last one.
        """
        people, tracks = tracked.people, tracker.tracks
        here = self._next(people.number, people.time_s)
        person_of = {person.name: person for person in people.people}
        fresh = [False] * len(tracks)
        for p, track in enumerate(tracks if tracked.past_states else ()):
            past = tracked.past_states.get(track.name)
            if past is not None:
                fresh[p] = not (past and self._add_past(track.number, past, here))
        numbers = [track.number for track in tracks]
        self._add_people(here, numbers, fresh, [person_of[track.name] for track in tracks], tracker.state, tracked)

    def add_parts(self, tracker: PartTracker, bodies: BodyFrame) -> None:
        """Add the part tracks of a frame; this is the history of that part.

        Args:
            tracker: Tracker of the part after the frame.
            bodies: Bodies of the frame.

        Raises:
            DetectionsError: If the frame is not later than the last one.
        """
        here = self._next(bodies.number, bodies.time_s)
        numbers = dict(zip(bodies.names, bodies.numbers, strict=True))
        found, fresh = [numbers[part.name] for part in tracker.tracks], [part.fresh for part in tracker.tracks]
        self._add_people(here, found, fresh, list(tracker.people), tracker.state, None)

    def _add_people(
        self,
        here: int,
        numbers: list[int],
        fresh: list[bool],
        people: list[Person],
        state: State,
        tracked: TrackedFrame | None,
    ) -> None:
        """Add the entries of all people in a frame."""
        if not people:
            return
        rows, used = np.array([each.rows for each in people]), np.array([each.used for each in people])
        assigned = None if tracked is None else tracked.assigned
        if assigned is None or not len(assigned.keypoints_px):
            seen = self._unseen(rows, used)
        else:
            among = assigned.numbers
            index = np.array([among.index(number) if number in among else -1 for number in numbers])
            seen = SeenPeople(
                rows, used, index, assigned.rows, assigned.labels, kernel_array(assigned.keypoints_px),
                assigned.confidence, self.settings.node_keypoints,
            )  # fmt: skip
        life, missing_s = [each.state for each in people], [each.missing_s for each in people]
        heads = RowHeads(
            here, np.array(numbers), np.array(fresh), np.array(life, dtype=np.int8), np.array(missing_s, dtype=float)
        )
        self._put(heads, state, seen)

    def _unseen(self, rows: np.ndarray, used: np.ndarray) -> SeenPeople:
        """Return what the views show of people whose keypoints are not kept."""
        none, views, keypoints = np.full(len(rows), -1), *used.shape[1:]
        return SeenPeople(
            rows, used, none, np.empty((0, views), dtype=np.int64), np.empty((0, views, keypoints), dtype=np.int64),
            kernel_array(np.empty((0, keypoints, 2))), kernel_array(np.empty((0, keypoints))),
            self.settings.node_keypoints,
        )  # fmt: skip

    def _next(self, number: int, time_s: float) -> int:
        """Start a frame and return its index in the history."""
        if self.numbers and number <= self.numbers[-1]:
            raise DetectionsError(
                f"Frame {number} follows frame {self.numbers[-1]}; frames must be added to a history in order."
            )
        self.numbers.append(number)
        self.time_s.append(time_s)
        here = len(self.numbers) - 1
        if not self._blocks or time_s - self.time_s[self._blocks[-1].first] >= _BLOCK_S:
            self._blocks.append(Block(here))
            complete = -1 - self._open_blocks
            if len(self._blocks) > self._open_blocks and self._blocks[complete].spooled_at is None:
                self._settle()
                self._blocks[complete].spool(self._spool, self._thread)
        return here

    def _add_past(self, number: int, past: list[PastState], here: int) -> bool:
        """Add the states before the confirmation of a track; return whether there are any.

        The frames between them without an observation hold predictions.
        """
        s = self.settings
        # The blocks that are open hold at least these frames, wherever the history begins.
        since_s = self.time_s[here] - _BLOCK_S
        by_place = {self.place(each.number): each for each in past if each.number >= self.numbers[0]}
        by_place = {place: each for place, each in by_place.items() if self.time_s[place] >= since_s}
        if not by_place:
            return False
        state, last_seen_s = select_states(by_place[min(by_place)].state, [0]), 0.0
        views, keypoints = len(s.rig), len(s.skeleton)
        unseen = self._unseen(np.full((1, views), -1), np.zeros((1, views, keypoints), dtype=bool))
        own, labels = np.arange(views)[None], np.tile(np.arange(keypoints), (1, views, 1))
        for place in range(min(by_place), here):
            each, seen = by_place.get(place), unseen
            if each is not None:
                state, last_seen_s = select_states(each.state, [0]), self.time_s[place]
                used = np.tile(each.rows[:, None] >= 0, (1, keypoints))
                pixels, confidence = kernel_array(each.keypoints_px), kernel_array(each.confidence)
                seen = SeenPeople(
                    each.rows[None], used[None], np.zeros(1, dtype=np.int64), own, labels, pixels, confidence,
                    s.node_keypoints,
                )  # fmt: skip
            else:
                dt_s = np.array([self.time_s[place] - self.time_s[place - 1]])
                predict_people(dt_s, s.motion, state)
            fresh, life = np.array([place == min(by_place)]), np.array([TrackState.TENTATIVE], dtype=np.int8)
            missing_s = np.array([self.time_s[place] - last_seen_s])
            self._put(RowHeads(place, np.array([number]), fresh, life, missing_s), state, seen)
        return True

    def _put(self, heads: RowHeads, state: State, seen: SeenPeople) -> None:
        """Add entries of a frame, or replace them."""
        for p, (number, free) in enumerate(zip(heads.number.tolist(), state.free.tolist(), strict=True)):
            self._extend_epoch(number, heads.place, None if free else state.shape[p])
        block = next(block for block in reversed(self._blocks) if block.first <= heads.place)
        block.table.add(heads, state, seen)

    def _extend_epoch(self, number: int, place: int, shape_m: np.ndarray | None) -> None:
        """Add a frame to the last epoch of a track, or begin one if the track's lengths are reestimated or replaced."""
        epochs = self.epochs.setdefault(number, [])
        if epochs:
            last = epochs[-1]
            known_m = last.shape_m
            if shape_m is None or known_m is None:
                continues = known_m is None
            else:
                continues = _equal(shape_m, known_m) or not _differ(shape_m, known_m)
            if continues:
                # To keep equal lengths is faster than to copy the new ones.
                if shape_m is not None and (known_m is None or not _equal(shape_m, known_m)):
                    known_m = shape_m.copy()
                epochs[-1] = Epoch(min(last.start, place), max(last.stop, place + 1), known_m)
                return
        epochs.append(Epoch(place, place + 1, None if shape_m is None else shape_m.copy()))

    def place(self, number: int) -> int:
        """Return the index of the frame with a number.

        Raises:
            DetectionsError: If there is no such frame.
        """
        place = bisect_left(self.numbers, number)
        if place == len(self.numbers) or self.numbers[place] != number:
            raise DetectionsError(f"The history has no frame {number}.")
        return place

    def place_at(self, time_s: float) -> int:
        """Return the index of the first frame after a time."""
        return bisect_right(self.time_s, time_s)

    def runs(self, start: int, stop: int, only: int | None = None) -> list[Run]:
        """Return the runs of tracks, as :meth:`packed_runs`, with their states."""
        return [packed.run() for packed in self.packed_runs(start, stop, only)]

    def packed_runs(self, start: int, stop: int, only: int | None = None) -> list[PackedRun]:
        """Return the runs of all tracks in the frames ``start`` to ``stop``, by track number, then by time.

        A track has several runs if it was interrupted, or if the filter was initialized again.

        Args:
            start: Index of the first frame.
            stop: Index after the last frame.
            only: Number of the only track to return; None for all.
        """
        self._settle()
        found: dict[int, list[Entries]] = {}
        ends = [*(block.first for block in self._blocks[1:]), len(self.numbers)]
        for block, end in zip(self._blocks, ends, strict=True):
            if block.first < stop and end > start:
                for number, entries in self._entries(block, start, stop).items():
                    if only in (None, number):
                        found.setdefault(number, []).append(entries)
        return [
            PackedRun(number, np.array(self.time_s[part.places[0] : part.places[-1] + 1]), part)
            for number, parts in found.items()
            for part in Entries.joined(parts).unbroken()
        ]

    def _entries(self, block: Block, start: int, stop: int) -> dict[int, Entries]:
        """Return the entries of some frames of a block by track number; blocks read from a spool are cached."""
        if block.spooled_at is None:
            return block.joined(start, stop)
        if block.first not in self._recent:
            while len(self._recent) >= _MAX_CACHED_BLOCKS:
                del self._recent[next(iter(self._recent))]
            self._recent[block.first] = self._spool.read(block.spooled_at)
        inside = {number: entries.within(start, stop) for number, entries in self._recent[block.first].items()}
        return {number: entries for number, entries in inside.items() if len(entries)}


def _equal(shape_m: np.ndarray, other_m: np.ndarray) -> bool:
    """Return whether lengths are the same; to compare a few bytes is much faster than to compare arrays."""
    return shape_m.tobytes() == other_m.tobytes()


def _differ(shape_m: np.ndarray, other_m: np.ndarray) -> bool:
    """Return whether lengths are those of another body, and not refined ones of the same."""
    return bool(np.median(np.abs(shape_m - other_m) / np.abs(other_m)) > _OTHER_BODY)
