"""Warnings about silent cameras and wrong clocks while a stream runs."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from posefuse.live.statistics import ViewCounts

EVERY_S = 1.0
"""Interval between checks, in seconds."""
_FEW = 5
"""Minimum number of messages for a verdict, and maximum number of warnings per camera."""
_MANY_JUMPS = 3

_Fault = Literal["", "silent", "early", "late"]


class CameraWarnings:
    """Report each fault once when it starts and once when it ends.

    Args:
        names: camera names.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._before = [ViewCounts() for _ in names]
        self._fault: list[_Fault] = ["" for _ in names]
        self._reported: Counter[int] = Counter()
        self._jumps = self._jumpy = 0

    def check(self, counts: Sequence[ViewCounts], silent: Sequence[bool], jumps: int) -> list[str]:
        """Return new warnings.

        Args:
            counts: statistics of each camera since the start.
            silent: whether each camera is silent.
            jumps: number of times that the clocks of most cameras jumped.
        """
        warnings = []
        # If all cameras are silent, the stream has not started or has ended.
        if not all(silent):
            for view, count in enumerate(counts):
                warnings += self._of_camera(view, count, silent[view])
        self._jumpy = self._jumpy + 1 if jumps - self._jumps >= _MANY_JUMPS else 0
        self._jumps = jumps
        if self._jumpy == 2:
            warnings.append(
                "The clocks of most cameras jump repeatedly. time_s must be in seconds; check that it is not in "
                "milliseconds."
            )
        return warnings

    def _of_camera(self, view: int, count: ViewCounts, silent: bool) -> list[str]:
        before, self._before[view] = self._before[view], replace(count)
        fault = _fault(before, count, silent)
        if fault is None or fault == self._fault[view]:
            return []
        self._fault[view] = fault
        self._reported[view] += 1
        if self._reported[view] > _FEW:
            return []
        more = " Further changes are counted only." if self._reported[view] == _FEW else ""
        return [f"{self._names[view]} {_SENTENCES[fault]}{more}"]


_SENTENCES: dict[_Fault, str] = {
    "": "is active again and used.",
    "silent": "sends nothing; people are tracked without it.",
    "early": "sends times ahead of the others' clocks; its messages are dropped.",
    "late": "sends times behind the others, or too late; its messages are dropped.",
}


def _fault(before: ViewCounts, now: ViewCounts, silent: bool) -> _Fault | None:
    """Return the fault of a camera, or None if too few messages arrived."""
    if silent:
        return "silent"
    if now.used > before.used:
        return ""
    early, late = now.early - before.early, now.late - before.late
    if now.received - before.received < _FEW or not early + late:
        return None
    return "early" if early > late else "late"
