"""A bounded queue of output lines for one consumer, and the counts of what was sent and dropped."""

import threading
from collections import Counter, deque

FLUSH_S = 2.0
"""Maximum time for sending the last lines when a stream ends."""
QUEUE_FULL = "queue full"
NOT_TAKEN = "not taken before the end"


class SinkCounts:
    """Counts of a sink; threads may share them.

    Attributes:
        sent: lines handed to a consumer or to the network library; each consumer counts.
        dropped: dropped lines by reason.
    """

    def __init__(self) -> None:
        self.sent = 0
        self.dropped: Counter[str] = Counter()
        self._lock = threading.Lock()

    def send(self) -> None:
        """Count a sent line."""
        with self._lock:
            self.sent += 1

    def drop(self, why: str, number: int = 1) -> None:
        """Count dropped lines."""
        with self._lock:
            if number:
                self.dropped[why] += number


class Outbox:
    """Holds lines until a thread sends them; if they are too many, the oldest are dropped.

    Args:
        most: maximum number of lines.
        counts: counts to update.
    """

    def __init__(self, most: int, counts: SinkCounts) -> None:
        self._most, self._counts = most, counts
        self._lines: deque[bytes] = deque()
        self._closed = False
        self._changed = threading.Condition()

    def put(self, line: bytes) -> None:
        """Add a line without waiting."""
        with self._changed:
            self._lines.append(line)
            if len(self._lines) > self._most:
                self._lines.popleft()
                self._counts.drop(QUEUE_FULL)
            self._changed.notify_all()

    def take(self, timeout_s: float) -> bytes | None:
        """Return the oldest line, or None if none arrives in time."""
        with self._changed:
            if not self._lines and not self._closed:
                self._changed.wait(timeout_s)
            return self._lines.popleft() if self._lines else None

    def close(self) -> None:
        """Accept the lines so far as the last ones."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def finished(self) -> bool:
        """Whether the outbox is closed and empty."""
        with self._changed:
            return self._closed and not self._lines

    def abandon(self, why: str) -> None:
        """Drop all waiting lines and close."""
        with self._changed:
            self._counts.drop(why, len(self._lines))
            self._lines.clear()
            self._closed = True
            self._changed.notify_all()
