"""A bounded queue of received lines; dropped lines are counted."""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple

_MOST_BYTES = 64 << 20


class ReceivedLine(NamedTuple):
    """A received line.

    Attributes:
        line: content without line feed.
        at_s: time of arrival by the queue's clock.
        sender: name of the sender; empty for a single one.
        number: line number of this sender.
    """

    line: bytes
    at_s: float
    sender: str = ""
    number: int = 0

    @property
    def origin(self) -> str:
        """Description of the line's origin."""
        return f"{self.sender} line {self.number}".lstrip()


class LineQueue:
    """Thread-safe queue of lines in the order of arrival.

    Args:
        most: maximum number of waiting lines.
        waits: whether a sender waits if the queue is full; otherwise the oldest line is dropped.
        clock: clock for times of arrival.
    """

    def __init__(self, most: int, *, waits: bool, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock = clock
        self.lost: Counter[str] = Counter()
        """Number of dropped lines by reason."""
        self.failure: Exception | None = None
        """Error that ended the input, or None."""
        self._most, self._waits = most, waits
        self._lines: deque[ReceivedLine] = deque()
        self._bytes = 0
        self._closed = False
        self._changed = threading.Condition()

    def put(self, line: bytes, sender: str = "", number: int = 0) -> None:
        """Add a line; after the end it is dropped."""
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
        """Count input that did not become a line."""
        with self._changed:
            self.lost[why] += 1

    def close(self, failure: Exception | None = None) -> None:
        """End the input."""
        # No lock: a signal handler may run while this thread holds it.
        self.failure = self.failure or failure
        self._closed = True

    @property
    def closed(self) -> bool:
        """Whether the input has ended."""
        return self._closed

    @property
    def finished(self) -> bool:
        """Whether the input has ended and all lines were taken."""
        return self._closed and not self._lines

    def take(self, timeout_s: float, most: int | None = None) -> tuple[list[ReceivedLine], float]:
        """Return waiting lines and the time up to which they are complete; wait for a line if there is none.

        Args:
            timeout_s: maximum waiting time.
            most: maximum number of lines; default: all.
        """
        with self._changed:
            if not self._lines and not self._closed and timeout_s > 0.0:
                self._changed.wait(timeout_s)
            number = len(self._lines) if most is None else min(most, len(self._lines))
            taken = [self._lines.popleft() for _ in range(number)]
            self._bytes -= sum(len(each.line) for each in taken)
            self._changed.notify_all()
            # Remaining lines arrived after the last one taken.
            return taken, taken[-1].at_s if self._lines and taken else self.clock()

    @property
    def _full(self) -> bool:
        return len(self._lines) > self._most - self._waits or self._bytes > _MOST_BYTES
