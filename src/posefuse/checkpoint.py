"""The protocol by which long work stores finished parts, so that an interrupted run can resume.

:class:`posefuse.io.checkpoints.CheckpointFolder` stores parts in a folder; :data:`NO_CHECKPOINT` stores nothing.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any, Protocol


class Spool(Protocol):
    """An append-only store for values that are needed again later, but not in between."""

    def add(self, value: Any) -> int:
        """Append a value and return its position."""
        ...

    def read(self, place: int) -> Any:
        """Return the value at a position."""
        ...


class Checkpoint(Protocol):
    """Stores the finished parts of one piece of work by name."""

    @property
    def enabled(self) -> bool:
        """Whether parts are stored at all."""
        ...

    def contains(self, name: str) -> bool:
        """Return whether a part of this name is stored."""
        ...

    def load(self, name: str) -> Any:
        """Return the part of this name, or None if it is absent or damaged."""
        ...

    def save(self, name: str, value: Any) -> Any:
        """Store a part, replacing one of the same name, and return it as :meth:`load` would.

        Callers continue with the returned value, so that an uninterrupted run computes the same as a resumed one.
        """
        ...

    def begin_save(self, name: str, value: Any, thread: Executor) -> tuple[Any, Callable[[], None]]:
        """Do the same in a thread, and also return a function that waits until the part is stored.

        Until then, only the thread may append to the part's spools, after the part is stored.
        """
        ...

    def discard(self, name: str) -> None:
        """Remove the part of this name, if it is stored."""
        ...

    def spool(self, name: str) -> Spool | None:
        """Open the spool that stored parts refer to, truncated to its length at the last :meth:`save`.

        Return None if nothing is stored.
        """
        ...

    def child(self, name: str) -> "Checkpoint":
        """Return a checkpoint for a part of the work, with names of its own."""
        ...


class NoCheckpoint:
    """A checkpoint that stores nothing; interrupted work starts again from the beginning."""

    enabled = False

    def contains(self, name: str) -> bool:
        """Return False."""
        return False

    def load(self, name: str) -> Any:
        """Return None."""

    def save(self, name: str, value: Any) -> Any:
        """Return the value unchanged."""
        return value

    def begin_save(self, name: str, value: Any, thread: Executor) -> tuple[Any, Callable[[], None]]:
        """Return the value unchanged, and a function that does nothing."""
        return value, _nothing

    def discard(self, name: str) -> None:
        """Do nothing."""

    def spool(self, name: str) -> Spool | None:
        """Return None; values stay in memory."""

    def child(self, name: str) -> Checkpoint:
        """Return this object."""
        return self


def _nothing() -> None:
    pass


NO_CHECKPOINT = NoCheckpoint()
