"""A bounded queue of lines between receiving threads and the session; dropped lines are counted."""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple

_MAX_BYTES = 64 << 20


class ReceivedLine(NamedTuple):
    """A line and its time of arrival.

    Attributes:
        line: the line without its line ending.
        at_s: time of arrival by the queue's clock.
        sender: name of the sender in messages; empty if there is only one.
        number: number of the line among those of its sender.
    """

    line: bytes
    at_s: float
    sender: str = ""
    number: int = 0

    @property
    def origin(self) -> str:
        """Sender and number of the line, for messages."""
        return f"{self.sender} line {self.number}".lstrip()


class LineQueue:
    """Holds lines in the order of arrival; threads may share it.

    Args:
        most: maximum number of lines.
        waits: whether a sender waits while the queue is full; otherwise the oldest line is dropped.
        clock: returns the time of arrival.
    """

    def __init__(self, most: int, *, waits: bool, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock = clock
        self.lost: Counter[str] = Counter()
        """Number of lost lines by reason."""
        self.failure: Exception | None = None
        """The error that ended receiving, or None."""
        self._most, self._waits = most, waits
        self._lines: deque[ReceivedLine] = deque()
        self._bytes = 0
        self._closed = False
        self._changed = threading.Condition()

    def put(self, line: bytes, sender: str = "", number: int = 0) -> None:
        """Add a line; after :meth:`close` it is lost."""
        with self._changed:
            while self._waits and self._full and not self._closed:
                self._changed.wait(0.1)
            if self._closed:
                self.lost["received after the end"] += 1
                return
            self._lines.append(ReceivedLine(line, self.clock(), sender, number))
            self._bytes += len(line)
            while self._full and not self._waits and len(self._lines) > 1:
                self._bytes -= len(self._lines.popleft().line)
                self.lost["queue full"] += 1
            self._changed.notify_all()

    def lose(self, why: str) -> None:
        """Count input that never became a line."""
        with self._changed:
            self.lost[why] += 1

    def close(self, failure: Exception | None = None) -> None:
        """Close the queue: nothing more is received."""
        # No lock: a signal handler may run while this thread holds it.
        self.failure = self.failure or failure
        self._closed = True

    @property
    def closed(self) -> bool:
        """Whether the queue is closed."""
        return self._closed

    @property
    def finished(self) -> bool:
        """Whether the queue is closed and empty."""
        return self._closed and not self._lines

    def take(self, timeout_s: float, most: int | None = None) -> tuple[list[ReceivedLine], float]:
        """Return lines that have arrived, and the time up to which they are complete; wait if there is none.

        Args:
            timeout_s: maximum time to wait.
            most: maximum number of lines, by default all.
        """
        with self._changed:
            if not self._lines and not self._closed and timeout_s > 0.0:
                self._changed.wait(timeout_s)
            number = len(self._lines) if most is None else min(most, len(self._lines))
            taken = [self._lines.popleft() for _ in range(number)]
            self._bytes -= sum(len(each.line) for each in taken)
            self._changed.notify_all()
            # The remaining lines arrived no earlier than the last one returned.
            return taken, taken[-1].at_s if self._lines and taken else self.clock()

    @property
    def _full(self) -> bool:
        return len(self._lines) > self._most - self._waits or self._bytes > _MAX_BYTES
