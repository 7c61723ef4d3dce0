"""Split bytes into lines of limited length and rate."""

from codecs import BOM_UTF8

from posefuse.live.line_queue import LineQueue
from posefuse.model.options.stream import StreamOptions

TOO_LONG, TOO_FAST = "longer than max_line_bytes", "more than max_messages_hz"


class LineSplitter:
    """Splits a stream of bytes into lines in bounded memory.

    Args:
        most_bytes: maximum length of a line; longer lines are dropped.
    """

    def __init__(self, most_bytes: int) -> None:
        self.most_bytes = most_bytes
        self.number = 0
        """Number of the last complete line."""
        self.too_long = 0
        self._begun = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Return the non-empty lines that end in these bytes, with their numbers from 1 on."""
        *ended, rest = data.split(b"\n")
        lines = []
        for piece in ended:
            self.number += 1
            whole = self._begun + piece
            if self.number == 1:
                # Some editors and consoles write a byte order mark.
                whole = whole.removeprefix(BOM_UTF8)
            if self._skipping or len(whole) > self.most_bytes:
                self.too_long += 1
            elif whole.strip():
                lines.append((self.number, whole))
            self._begun, self._skipping = b"", False
        self._begun += rest
        if len(self._begun) > self.most_bytes:
            self._begun, self._skipping = b"", True
        elif self._skipping:
            self._begun = b""
        return lines

    def end(self) -> list[tuple[int, bytes]]:
        """Return the last line if it has no line ending."""
        return self.feed(b"\n") if self._begun or self._skipping else []


class RateLimiter:
    """Limits the rate of messages, allowing bursts of one second.

    Args:
        rate_hz: maximum average rate.
        now_s: current time.
    """

    def __init__(self, rate_hz: float, now_s: float) -> None:
        self.rate_hz = rate_hz
        self._left, self._last_s = max(rate_hz, 1.0), now_s

    def spend(self, now_s: float) -> bool:
        """Return whether one more message is allowed, and count it."""
        earned = (now_s - self._last_s) * self.rate_hz
        self._left = min(max(self.rate_hz, 1.0), self._left + max(0.0, earned))
        self._last_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Sender:
    """Puts the lines of one sender into the queue and counts those beyond its limits.

    Args:
        queue: queue of the stream.
        options: options of the stream.
        limited: whether the message rate is limited; not needed where senders wait.
        name: name of the sender, if there are several.
    """

    def __init__(self, queue: LineQueue, options: StreamOptions, *, limited: bool, name: str = "") -> None:
        self._inbox, self._name = queue, name
        self._splitter = LineSplitter(options.max_line_bytes)
        self._limiter = RateLimiter(options.max_messages_hz, queue.clock()) if limited else None

    def feed(self, data: bytes) -> None:
        """Process received bytes."""
        self._put(self._splitter.feed(data))

    def end(self) -> None:
        """Process the end of the input."""
        self._put(self._splitter.end())

    def _put(self, lines: list[tuple[int, bytes]]) -> None:
        for _ in range(self._splitter.too_long):
            self._inbox.lose(TOO_LONG)
        self._splitter.too_long = 0
        for number, line in lines:
            if self._limiter is None or self._limiter.spend(self._inbox.clock()):
                self._inbox.put(line, self._name, number)
            else:
                self._inbox.lose(TOO_FAST)
