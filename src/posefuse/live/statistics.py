"""What is counted of a stream: in bounded memory, however long it runs."""

import math
from collections import Counter
from dataclasses import dataclass, field

_LEAST_S, _MOST_S, _PER_DECADE = 1e-5, 1e3, 40


@dataclass
class ViewCounts:
    """Of one camera's messages.

    Attributes:
        received: that could be read.
        used: that went into a frame.
        late: whose frame had gone on, or farther back than ``max_jump_s``.
        early: farther ahead than ``max_jump_s``.
        duplicate: the second of the same time.
        out_of_order: of those used, that came after a later one.
        malformed: that named the camera and could not be used.
        missing: frames that went on without it.
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
    """How long things took, as counts between steps of 6 %."""

    def __init__(self) -> None:
        self._counts: Counter[int] = Counter()
        self.most_s = 0.0

    def add(self, latency_s: float) -> None:
        """One more."""
        bounded = min(max(latency_s, _LEAST_S), _MOST_S)
        self._counts[math.ceil(_PER_DECADE * math.log10(bounded / _LEAST_S))] += 1
        self.most_s = max(self.most_s, latency_s)

    def __len__(self) -> int:
        return self._counts.total()

    def quantile_s(self, share: float) -> float:
        """So many were no longer, at most 6 % too much; NaN of none."""
        wanted, seen = share * len(self), 0
        for step in sorted(self._counts):
            seen += self._counts[step]
            if seen >= wanted:
                return min(_LEAST_S * 10.0 ** (step / _PER_DECADE), self.most_s)
        return math.nan


@dataclass
class StreamCounts:
    """Of a whole stream.

    Attributes:
        lines: that came in and were read.
        malformed: of them, by what was wrong.
        lost: what never became a line or was not read, by why.
        complete: frames in which every camera is.
        incomplete: frames without some.
        frames_dropped: frames that were dropped because following them was behind.
        refused: frames that the tracker would not take.
        complete_s: latencies of complete frames.
        incomplete_s: of the others.
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
