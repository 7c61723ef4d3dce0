"""A few seconds of a history: entries of all tracks, in memory until they move to a spool."""

import sys
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field

from posefuse.checkpoint import Spool
from posefuse.tracking.history_entries import Entries, EntryTable


@dataclass(eq=False)
class Block:
    """A few seconds of entries; in a spool once the block is complete.

    Attributes:
        first: Index of the first frame.
        table: The entries while they are in memory.
        spooled_at: Position in the spool; None while the block is in memory.
        moving: The position that a thread determines while it moves the block to the spool; None otherwise.
    """

    first: int
    table: EntryTable = field(default_factory=EntryTable)
    spooled_at: int | None = None
    moving: Future[int] | None = None

    def joined(self, start: int, stop: int) -> dict[int, Entries]:
        """Return the entries of the frames ``start`` to ``stop`` by track number; not for spooled blocks."""
        return self.table.by_track(start, stop)

    def spool(self, spool: Spool, thread: Executor | None = None) -> None:
        """Move the entries into a spool; with a thread, until :meth:`settle`. No entry may be added afterward."""
        if thread is None:
            self._moved_to(self._append(spool))
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
        self.spooled_at, self.table = place, EntryTable()
