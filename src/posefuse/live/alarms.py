"""What somebody beside the cameras has to know while it happens: who is silent, whose clock is wrong."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from posefuse.live.statistics import ViewCounts

EVERY_S = 1.0
"""How often to look."""
_FEW = 5
"""Messages that may be a coincidence; and how often something is said of one camera."""
_MANY_JUMPS = 3

_Trouble = Literal["", "silent", "early", "late"]


class Alarms:
    """Says once what goes wrong, and once that it is over.

    Args:
        names: of the cameras.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._before = [ViewCounts() for _ in names]
        self._trouble: list[_Trouble] = ["" for _ in names]
        self._said: Counter[int] = Counter()
        self._jumps = self._jumpy = 0

    def look(self, counts: Sequence[ViewCounts], silent: Sequence[bool], jumps: int) -> list[str]:
        """What is new, in sentences.

        Args:
            counts: of each camera, from the beginning on.
            silent: whether each has not been heard for some time.
            jumps: how often most cameras' clocks jumped, from the beginning on.
        """
        said = []
        # With nobody there, the stream has not begun or is over.
        if not all(silent):
            for view, count in enumerate(counts):
                said += self._of_camera(view, count, silent[view])
        self._jumpy = self._jumpy + 1 if jumps - self._jumps >= _MANY_JUMPS else 0
        self._jumps = jumps
        if self._jumpy == 2:
            said.append(
                "The clocks of most cameras jump again and again. time_s is in seconds: is it in milliseconds here?"
            )
        return said

    def _of_camera(self, view: int, count: ViewCounts, silent: bool) -> list[str]:
        before, self._before[view] = self._before[view], replace(count)
        trouble = _trouble(before, count, silent)
        if trouble is None or trouble == self._trouble[view]:
            return []
        self._trouble[view] = trouble
        self._said[view] += 1
        if self._said[view] > _FEW:
            return []
        more = " More about it is counted alone." if self._said[view] == _FEW else ""
        return [f"{self._names[view]} {_SENTENCES[trouble]}{more}"]


_SENTENCES: dict[_Trouble, str] = {
    "": "is heard again, and used.",
    "silent": "sends nothing; people are followed without it.",
    "early": "sends times ahead of the others' clocks; its messages are dropped.",
    "late": "sends times behind the others, or too late; its messages are dropped.",
}


def _trouble(before: ViewCounts, now: ViewCounts, silent: bool) -> _Trouble | None:
    """What is wrong with a camera; None where too little came to tell."""
    if silent:
        return "silent"
    if now.used > before.used:
        return ""
    early, late = now.early - before.early, now.late - before.late
    if now.received - before.received < _FEW or not early + late:
        return None
    return "early" if early > late else "late"
