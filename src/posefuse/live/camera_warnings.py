"""Monitor the cameras of a stream: silent cameras and wrong clocks."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from posefuse.live.statistics import ViewCounts

CHECK_PERIOD_S = 1.0
"""Time between two checks."""
_MIN_MESSAGES = 5
"""Minimum number of messages to judge a camera's clock, and maximum number of warnings per camera."""
_MIN_JUMPS = 3

_Trouble = Literal["", "silent", "early", "late"]


class CameraWarnings:
    """Reports each problem of a camera once, and its end once.

    Args:
        names: names of the cameras.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._before = [ViewCounts() for _ in names]
        self._trouble: list[_Trouble] = ["" for _ in names]
        self._n_reported: Counter[int] = Counter()
        self._jumps = self._jumpy = 0

    def check(self, counts: Sequence[ViewCounts], silent: Sequence[bool], jumps: int) -> list[str]:
        """Return sentences on the changes since the last check.

        Args:
            counts: message counts of each camera since the start.
            silent: whether each camera has sent nothing for some time.
            jumps: number of times that most cameras' clocks jumped since the start.
        """
        sentences = []
        # If all cameras are silent, the stream has not begun or is over.
        if not all(silent):
            for view, count in enumerate(counts):
                sentences += self._of_camera(view, count, silent[view])
        self._jumpy = self._jumpy + 1 if jumps - self._jumps >= _MIN_JUMPS else 0
        self._jumps = jumps
        if self._jumpy == 2:
            sentences.append(
                "The clocks of most cameras jump repeatedly. time_s must be in seconds; is it in milliseconds?"
            )
        return sentences

    def _of_camera(self, view: int, count: ViewCounts, silent: bool) -> list[str]:
        before, self._before[view] = self._before[view], replace(count)
        trouble = _trouble(before, count, silent)
        if trouble is None or trouble == self._trouble[view]:
            return []
        self._trouble[view] = trouble
        self._n_reported[view] += 1
        if self._n_reported[view] > _MIN_MESSAGES:
            return []
        more = " Further changes are only counted." if self._n_reported[view] == _MIN_MESSAGES else ""
        return [f"{self._names[view]} {_SENTENCES[trouble]}{more}"]


_SENTENCES: dict[_Trouble, str] = {
    "": "sends again and is used.",
    "silent": "sends nothing; people are tracked without it.",
    "early": "sends times ahead of the other clocks; its messages are dropped.",
    "late": "sends times behind the other clocks, or too late; its messages are dropped.",
}


def _trouble(before: ViewCounts, now: ViewCounts, silent: bool) -> _Trouble | None:
    """Return the problem of a camera; None with too few messages to judge."""
    if silent:
        return "silent"
    if now.used > before.used:
        return ""
    early, late = now.early - before.early, now.late - before.late
    if now.received - before.received < _MIN_MESSAGES or not early + late:
        return None
    return "early" if early > late else "late"
