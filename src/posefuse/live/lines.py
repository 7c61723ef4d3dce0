"""Bytes become lines, none longer and no more a second than said."""

from codecs import BOM_UTF8

from posefuse.live.inbox import Inbox
from posefuse.model.options.stream import StreamOptions

TOO_LONG, TOO_FAST = "longer than max_line_bytes", "more than max_messages_hz"


class LineSplitter:
    """Cuts a stream of bytes into lines, in bounded memory.

    Args:
        most_bytes: of a line; of longer ones nothing is kept.
    """

    def __init__(self, most_bytes: int) -> None:
        self.most_bytes = most_bytes
        self.number = 0
        """Of the last line that ended."""
        self.too_long = 0
        self._begun = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Numbers from 1 on, and the lines that end in these bytes, without their ends; empty ones are left out."""
        *ended, rest = data.split(b"\n")
        lines = []
        for piece in ended:
            self.number += 1
            whole = self._begun + piece
            if self.number == 1:
                # What some editors and consoles put before a text.
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
        """The last line, where it lacks its end."""
        return self.feed(b"\n") if self._begun or self._skipping else []


class Allowance:
    """How many messages a sender may send: so many a second, and those of one second at once.

    Args:
        rate_hz: on average.
        now_s: the time.
    """

    def __init__(self, rate_hz: float, now_s: float) -> None:
        self.rate_hz = rate_hz
        self._left, self._last_s = max(rate_hz, 1.0), now_s

    def spend(self, now_s: float) -> bool:
        """Whether one more is allowed."""
        earned = (now_s - self._last_s) * self.rate_hz
        self._left = min(max(self.rate_hz, 1.0), self._left + max(0.0, earned))
        self._last_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Sender:
    """Whoever sends: puts lines into the inbox, and counts what it may not send.

    Args:
        inbox: where to.
        options: of the stream.
        limited: whether messages a second are; where the sender waits, there are never too many.
        name: of the sender, where there are several.
    """

    def __init__(self, inbox: Inbox, options: StreamOptions, *, limited: bool, name: str = "") -> None:
        self._inbox, self._name = inbox, name
        self._splitter = LineSplitter(options.max_line_bytes)
        self._allowance = Allowance(options.max_messages_hz, inbox.clock()) if limited else None

    def feed(self, data: bytes) -> None:
        """Bytes came in."""
        self._put(self._splitter.feed(data))

    def end(self) -> None:
        """No more will."""
        self._put(self._splitter.end())

    def _put(self, lines: list[tuple[int, bytes]]) -> None:
        for _ in range(self._splitter.too_long):
            self._inbox.lose(TOO_LONG)
        self._splitter.too_long = 0
        for number, line in lines:
            if self._allowance is None or self._allowance.spend(self._inbox.clock()):
                self._inbox.put(line, self._name, number)
            else:
                self._inbox.lose(TOO_FAST)
