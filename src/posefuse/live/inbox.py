"""Where lines wait between whoever receives them and whoever reads them: bounded, and what does not fit is counted."""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple

_MOST_BYTES = 64 << 20


class Arrived(NamedTuple):
    """A line, and when it arrived.

    Attributes:
        line: without its end.
        at_s: by the inbox's clock.
        sender: what is said before the line's number, to tell senders apart; empty of one alone.
        number: of the line, of all that its sender sent.
    """

    line: bytes
    at_s: float
    sender: str = ""
    number: int = 0

    @property
    def origin(self) -> str:
        """Which line it is, in words."""
        return f"{self.sender} line {self.number}".lstrip()


class Inbox:
    """Lines in the order of their arrival, from any thread.

    Args:
        most: how many may wait.
        waits: whether a sender waits where there is no room; else the oldest line is dropped.
        clock: stamps what arrives.
    """

    def __init__(self, most: int, *, waits: bool, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock = clock
        self.lost: Counter[str] = Counter()
        """What was received and is not in here, by why."""
        self.failure: Exception | None = None
        """Why nothing more comes, if that is an error."""
        self._most, self._waits = most, waits
        self._lines: deque[Arrived] = deque()
        self._bytes = 0
        self._closed = False
        self._changed = threading.Condition()

    def put(self, line: bytes, sender: str = "", number: int = 0) -> None:
        """A line arrives; after the end it is lost."""
        with self._changed:
            while self._waits and self._full and not self._closed:
                self._changed.wait(0.1)
            if self._closed:
                self.lost["came after the end"] += 1
                return
            self._lines.append(Arrived(line, self.clock(), sender, number))
            self._bytes += len(line)
            while self._full and not self._waits and len(self._lines) > 1:
                self._bytes -= len(self._lines.popleft().line)
                self.lost["too many waited"] += 1
            self._changed.notify_all()

    def lose(self, why: str) -> None:
        """Count something that never became a line."""
        with self._changed:
            self.lost[why] += 1

    def close(self, failure: Exception | None = None) -> None:
        """Nothing more will come."""
        # No lock: a signal's handler may run while this thread holds it.
        self.failure = self.failure or failure
        self._closed = True

    @property
    def closed(self) -> bool:
        """Whether nothing more will come."""
        return self._closed

    @property
    def finished(self) -> bool:
        """Whether all that came was taken, and nothing more will come."""
        return self._closed and not self._lines

    def take(self, timeout_s: float, most: int | None = None) -> tuple[list[Arrived], float]:
        """The lines that have arrived, and until when that was; waits for one if there is none.

        Args:
            timeout_s: waits no longer.
            most: takes no more than so many; by default all.
        """
        with self._changed:
            if not self._lines and not self._closed and timeout_s > 0.0:
                self._changed.wait(timeout_s)
            number = len(self._lines) if most is None else min(most, len(self._lines))
            taken = [self._lines.popleft() for _ in range(number)]
            self._bytes -= sum(len(each.line) for each in taken)
            self._changed.notify_all()
            # Of lines that are left, none is from after the last that was taken.
            return taken, taken[-1].at_s if self._lines and taken else self.clock()

    @property
    def _full(self) -> bool:
        return len(self._lines) > self._most - self._waits or self._bytes > _MOST_BYTES
