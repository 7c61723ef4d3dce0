"""A few seconds of a history: entries of all tracks, in memory until they move to a spool."""

import sys
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field

from posefuse.checkpoint import Spool
from posefuse.tracking.history_entries import Entries


@dataclass(eq=False)
class Block:
    """A few seconds of entries, by track number and frame; in a spool once the block is complete.

    Attributes:
        first: Index of the first frame.
        entries: By track number and index of the frame: entries that are not packed.
        packed: By track number: entries of frames before all of ``entries``.
        spooled_at: Position in the spool; None while the block is in memory.
        moving: The position that a thread determines while it moves the block to the spool; None otherwise.
    """

    first: int
    entries: dict[int, dict[int, Entries]] = field(default_factory=dict)
    packed: dict[int, Entries] = field(default_factory=dict)
    spooled_at: int | None = None
    moving: Future[int] | None = None

    def put(self, number: int, place: int, entry: Entries) -> None:
        """Add the entry of a frame, or replace it."""
        own, packed = self.entries.setdefault(number, {}), self.packed.get(number)
        if packed is not None and place <= packed.places[-1]:
            del self.packed[number]
            singly = {int(each): packed.frames(i, i + 1) for i, each in enumerate(packed.places)}
            own = self.entries[number] = singly | own
        own[place] = entry

    def pack(self) -> None:
        """Join the entries of each track: a few large arrays are pickled much faster than many small ones."""
        for number, entries in self.joined(0, sys.maxsize).items():
            self.packed[number], self.entries[number] = entries, {}

    def joined(self, start: int, stop: int) -> dict[int, Entries]:
        """Return the entries of the frames ``start`` to ``stop`` by track number; not for spooled blocks."""
        found: dict[int, list[Entries]] = {}
        for number, entries in self.entries.items():
            packed = self.packed.get(number)
            parts = [] if packed is None else [packed.within(start, stop)]
            parts += [entries[place] for place in sorted(entries) if start <= place < stop]
            found[number] = [part for part in parts if len(part)]
        return {number: Entries.joined(parts) for number, parts in found.items() if parts}

    def spool(self, spool: Spool, thread: Executor | None = None) -> None:
        """Move the entries into a spool; with a thread, until :meth:`settle`. No entry may be added afterward."""
        if thread is None:
            self._moved_to(spool.add(self.joined(0, sys.maxsize)))
        elif self.moving is None:
            self.moving = thread.submit(self._append, spool)

    def _append(self, spool: Spool) -> int:
        return spool.add(self.joined(0, sys.maxsize))

    def settle(self) -> None:
        """Wait until a thread has moved the entries, if it does."""
        if self.moving is not None:
            place, self.moving = self.moving.result(), None
            self._moved_to(place)

    def _moved_to(self, place: int) -> None:
        self.spooled_at, self.entries, self.packed = place, {}, {}
