"""What the command line prints: words on stdout, progress, warnings and errors on stderr."""

import math
import os
import textwrap
from collections.abc import Sequence
from contextlib import AbstractContextManager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from posefuse.errors import handle_warnings

_WIDTH = 80


class _Pipe(Console):
    """A console whose reader may leave early: that is no reason to stop working."""

    def on_broken_pipe(self) -> None:
        """Write what is still to come to nowhere."""
        self.file = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


out = _Pipe(highlight=False, soft_wrap=False)
err = _Pipe(stderr=True, highlight=False)


class Bars:
    """Progress as bars that show once a stage takes longer than a second; implements the progress protocol."""

    _DELAY_S = 1.0

    def __init__(self) -> None:
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=err,
            transient=True,
        )
        self._task: TaskID | None = None
        self._since = 0.0

    def start(self, what: str, total: int) -> None:
        """A stage begins."""
        self._task = self._progress.add_task(what, total=total)
        self._since = self._progress.get_time()

    def advance(self, done: int) -> None:
        """Part of it is finished."""
        if self._task is None:
            return
        self._progress.advance(self._task, done)
        if (
            not self._progress.live.is_started
            and self._progress.get_time() - self._since > self._DELAY_S
            and err.is_terminal
        ):
            self._progress.start()

    def finish(self) -> None:
        """The stage has ended."""
        if self._task is not None:
            self._progress.remove_task(self._task)
        self._task = None
        if self._progress.live.is_started:
            self._progress.stop()

    def note(self, text: str) -> None:
        """Print a remark."""
        note(f"note: {text}")


def spoken_warnings() -> AbstractContextManager[None]:
    """Show posefuse's warnings as sentences on stderr, each once."""
    return handle_warnings(warn)


def table(title: str | None, columns: list[str], rows: list[list[str]], *, words: bool = False) -> None:
    """Print a table that fits 80 columns; all but the first column are right-aligned unless they hold words."""
    headed = any(columns)
    view = Table(title=title, title_justify="left", box=None, pad_edge=False, header_style="bold", show_header=headed)
    for i, column in enumerate(columns):
        view.add_column(column, justify="left" if words or i == 0 else "right", overflow="fold")
    for row in rows:
        view.add_row(*(Text(cell) for cell in row))
    out.print(view)


def note(text: str) -> None:
    """Print a sentence, broken into lines that fit the window; words longer than it, such as paths, stay whole."""
    out.print(Text(_broken(text, out.width)), soft_wrap=True)


def warn(text: str) -> None:
    """Print a warning."""
    complain("warning: ", "yellow", text)


def complain(kind: str, style: str, text: str) -> None:
    """Print what is wrong, on stderr, broken into lines that fit the window."""
    whole = _broken(kind + text, err.width)
    err.print(Text.assemble((kind, style), whole[len(kind) :]), soft_wrap=True)


def _broken(text: str, width: int) -> str:
    """Lines that fit; words longer than a line, such as paths, stay whole."""
    pieces = (textwrap.fill(line, width, break_long_words=False, break_on_hyphens=False) for line in text.split("\n"))
    return "\n".join(pieces)


def count(n: int, noun: str) -> str:
    """A number of things, as people write it."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def say(text: str) -> None:
    """Print a line; it may be longer than the window, paths are not broken."""
    out.print(Text(text), soft_wrap=True)


def lines(text: str, indent: int) -> list[str]:
    """A text in lines of 80 columns, indented, those after the first by four more; no word is broken."""
    first, others = " " * indent, " " * (indent + 4)
    return textwrap.wrap(
        text, _WIDTH, initial_indent=first, subsequent_indent=others, break_long_words=False, break_on_hyphens=False
    )


def wrote(files: Sequence[str], folder: object, remark: str = "") -> None:
    """Say what was written and where: as many names a line as fit 80 columns, none of them broken."""
    words = [f"{name}," for name in files[:-1]] + list(files[-1:])
    lines = textwrap.wrap(" ".join(["Wrote", *words]), _WIDTH, break_long_words=False, break_on_hyphens=False)
    place = f"to {folder}"
    lines = [*lines[:-1], f"{lines[-1]} {place}"] if len(lines[-1]) + len(place) < _WIDTH else [*lines, place]
    for line in [*lines, *([remark] if remark else [])]:
        say(line)


def percent(share: float) -> str:
    """A share as people read it; a dash where there is none."""
    return f"{100 * share:.1f} %" if math.isfinite(share) else "-"
