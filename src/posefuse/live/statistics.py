"""Statistics of a stream in bounded memory."""

import math
from collections import Counter
from dataclasses import dataclass, field

_LEAST_S, _MOST_S, _PER_DECADE = 1e-5, 1e3, 40


@dataclass
class ViewCounts:
    """Counts of one camera's messages.

    Attributes:
        received: messages that could be read.
        used: messages that became part of a frame.
        late: messages whose frame had been processed, or that were more than ``max_jump_s`` behind.
        early: messages more than ``max_jump_s`` ahead.
        duplicate: second messages of the same time.
        out_of_order: used messages that arrived after a later one.
        malformed: messages that named the camera and could not be used.
        missing: frames processed without the camera.
    """

    received: int = 0
    used: int = 0
    late: int = 0
    early: int = 0
    duplicate: int = 0
    out_of_order: int = 0
    malformed: int = 0
    missing: int = 0


class Latencies:
    """A histogram of latencies with bins of 6 %."""

    def __init__(self) -> None:
        self._counts: Counter[int] = Counter()
        self.most_s = 0.0

    def add(self, latency_s: float) -> None:
        """Add a latency."""
        bounded = min(max(latency_s, _LEAST_S), _MOST_S)
        self._counts[math.ceil(_PER_DECADE * math.log10(bounded / _LEAST_S))] += 1
        self.most_s = max(self.most_s, latency_s)

    def __len__(self) -> int:
        return self._counts.total()

    def quantile_s(self, share: float) -> float:
        """Return a quantile of the latencies, at most 6 % too large; NaN if there is none."""
        target, count = share * len(self), 0
        for step in sorted(self._counts):
            count += self._counts[step]
            if count >= target:
                return min(_LEAST_S * 10.0 ** (step / _PER_DECADE), self.most_s)
        return math.nan


@dataclass
class StreamCounts:
    """Counts of a whole stream.

    Attributes:
        lines: lines read.
        malformed: malformed lines by fault.
        lost: input that never became a line or was not read, by reason.
        complete: frames with every camera.
        incomplete: frames without some camera.
        frames_dropped: frames dropped because tracking was behind.
        refused: frames that the tracker rejected.
        complete_s: latencies of complete frames.
        incomplete_s: latencies of incomplete frames.
    """

    lines: int = 0
    malformed: Counter[str] = field(default_factory=Counter)
    lost: Counter[str] = field(default_factory=Counter)
    complete: int = 0
    incomplete: int = 0
    frames_dropped: int = 0
    refused: int = 0
    complete_s: Latencies = field(default_factory=Latencies)
    incomplete_s: Latencies = field(default_factory=Latencies)
