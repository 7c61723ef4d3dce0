"""Short descriptions of objects, as text and as HTML in notebooks."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from textwrap import shorten, wrap

_WIDTH, _LABEL_WIDTH, _MOST_NAMES = 80, 12, 8


@dataclass(frozen=True)
class Description:
    """What an object holds.

    Attributes:
        title: the type and the most important numbers, in a line.
        rows: labels and values.
    """

    title: str
    rows: tuple[tuple[str, str], ...] = ()

    def text(self) -> str:
        """Return lines of at most 80 columns."""
        lines = [shorten(self.title, _WIDTH, placeholder=" ...")]
        for label, value in self.rows:
            first, *others = wrap(value, _WIDTH - _LABEL_WIDTH - 2) or [""]
            # Two lines are enough to recognize an object.
            if len(others) > 1:
                others = [shorten(" ".join(others), _WIDTH - _LABEL_WIDTH - 2, placeholder=" ...")]
            lines += [f"  {f'{label} ':<{_LABEL_WIDTH}}{first}", *(" " * (_LABEL_WIDTH + 2) + each for each in others)]
        return "\n".join(lines)

    def html(self) -> str:
        """Return a table in the colors of the page."""
        cells = "".join(
            f'<tr><th style="text-align:left;font-weight:600;vertical-align:top">{escape(label)}</th>'
            f'<td style="text-align:left">{escape(value)}</td></tr>'
            for label, value in self.rows
        )
        return f"<div><strong>{escape(self.title)}</strong><table>{cells}</table></div>"


class Described:
    """Has a short representation; classes that derive from it state what it contains."""

    def _description(self) -> Description:
        raise NotImplementedError

    def __repr__(self) -> str:
        return self._description().text()

    def _repr_html_(self) -> str:
        return self._description().html()


def count(n: int, noun: str) -> str:
    """Return a number with its noun, such as ``2 cameras``."""
    plural = {"person": "people"}.get(noun, f"{noun}s")
    return f"{n} {noun if n == 1 else plural}"


def names(words: Sequence[str]) -> str:
    """Return names separated by commas; of many, the first ones and their number."""
    if len(words) <= _MOST_NAMES:
        return ", ".join(words)
    return f"{', '.join(words[: _MOST_NAMES - 1])} and {len(words) - _MOST_NAMES + 1} more"
