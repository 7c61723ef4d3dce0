"""Output of the command line: text on stdout; progress, warnings and errors on stderr.

Arguments that messages name in backticks are shown as flags (:mod:`posefuse.model.options.flags`).
"""

import math
import os
import re
import textwrap
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from posefuse.errors import handle_warnings
from posefuse.model.options.flags import as_flags

_WIDTH = 80
_LABEL_WIDTH = 12
_MOST_NOTE_LINES = 4


_PERSON_ENDINGS = (".trc", ".c3d", ".mot", ".bvh", ".glb")


class _Pipe(Console):
    """Console that keeps working when the reader of its output closes the pipe."""

    def on_broken_pipe(self) -> None:
        """Discard all further output."""
        self.file = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


_LABEL = re.compile(r"\s*[a-z][a-z ]*: ")
out = _Pipe(highlight=False, soft_wrap=False)
err = _Pipe(stderr=True, highlight=False)


@dataclass
class _Detail:
    """How much commands print.

    Attributes:
        verbose: whether everything is printed; otherwise notes are cut to a line and repeated ones are counted.
    """

    verbose: bool = False


detail = _Detail()


class _SpeedColumn(ProgressColumn):
    """Shows how many units of work are done per second."""

    def __init__(self, unit: str, stage: str) -> None:
        super().__init__()
        self._unit, self._stage = unit, stage

    def render(self, task: Task) -> Text:
        """Return the text of a stage."""
        hidden = task.speed is None or (self._stage and task.description != self._stage)
        return Text("" if hidden else f"{task.speed:.1f} {self._unit}/s")


class Bars:
    """Progress bars, shown once a stage takes longer than a second; implements the progress protocol.

    Args:
        unit: unit of work whose number per second is shown; empty to show none.
        stage: the only stage whose speed is shown; empty for all.
    """

    _DELAY_S = 1.0

    def __init__(self, unit: str = "", stage: str = "") -> None:
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            *([_SpeedColumn(unit, stage)] if unit else []),
            TimeRemainingColumn(),
            console=err,
            transient=True,
        )
        self._task: TaskID | None = None
        self._since = 0.0

    def start(self, what: str, total: int) -> None:
        """Start a stage."""
        self._task = self._progress.add_task(what, total=total)
        self._since = self._progress.get_time()

    def advance(self, done: int) -> None:
        """Report finished steps of the stage."""
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
        """Finish the stage."""
        if self._task is not None:
            self._progress.remove_task(self._task)
        self._task = None
        if self._progress.live.is_started:
            self._progress.stop()

    def note(self, text: str) -> None:
        """Print a remark."""
        note(f"note: {text}")


def print_warnings() -> AbstractContextManager[None]:
    """Print posefuse's warnings on stderr, each once."""
    return handle_warnings(warn)


def table(title: str | None, columns: list[str], rows: list[list[str]], *, words: bool = False) -> None:
    """Print a table that fits 80 columns; columns after the first are right-aligned unless they hold words."""
    headed = any(columns)
    view = Table(title=title, title_justify="left", box=None, pad_edge=False, header_style="bold", show_header=headed)
    for i, column in enumerate(columns):
        view.add_column(column, justify="left" if words or i == 0 else "right", overflow="fold")
    for row in rows:
        view.add_row(*(Text(as_flags(cell)) for cell in row))
    out.print(view)


def note(text: str) -> None:
    """Print a sentence, wrapped to the width of the window; longer words, such as paths, are not broken."""
    out.print(Text(_wrapped(as_flags(text), out.width)), soft_wrap=True)


def notes(texts: Sequence[str], where: str = "in the report and with --verbose") -> None:
    """Print notes; where they take many lines, only the beginnings of the first ones, except with ``--verbose``.

    Args:
        texts: the notes.
        where: where they are in full.
    """
    wrapped = [_wrapped(as_flags(f"note: {text}"), out.width) for text in texts]
    if detail.verbose or sum(text.count("\n") + 1 for text in wrapped) <= _MOST_NOTE_LINES:
        for text in texts:
            note(f"note: {text}")
        return
    shown = texts if len(texts) < _MOST_NOTE_LINES else texts[: _MOST_NOTE_LINES - 2]
    for text in shown:
        say(textwrap.shorten(f"note: {text}", min(out.width, _WIDTH), placeholder=" ..."))
    more = "in full" if len(texts) == len(shown) else f"and {len(texts) - len(shown)} more"
    say(f"note: {more} {where}")


def labeled(label: str, text: str) -> None:
    """Print a sentence after a label of twelve columns; further lines begin below the sentence."""
    lines = textwrap.wrap(as_flags(text), out.width - _LABEL_WIDTH, break_long_words=False, break_on_hyphens=False) or [
        ""
    ]
    first, *others = lines
    indent = " " * _LABEL_WIDTH
    out.print(Text("\n".join([f"{label:<{_LABEL_WIDTH}}{first}", *(indent + each for each in others)])), soft_wrap=True)


def warn(text: str) -> None:
    """Print a warning."""
    print_problem("warning: ", "yellow", text)


def print_problem(kind: str, style: str, text: str) -> None:
    """Print a warning or an error on stderr, wrapped to the width of the window."""
    whole = _wrapped(kind + as_flags(text), err.width)
    err.print(Text.assemble((kind, style), whole[len(kind) :]), soft_wrap=True)


def _wrapped(text: str, width: int) -> str:
    """Return the text in lines that fit; longer words, such as paths, are not broken.

    Lines that continue one with a label, such as ``warning:``, are indented by two spaces.
    """
    lines = []
    for line in text.split("\n"):
        indent = line[: len(line) - len(line.lstrip())] + ("  " if _LABEL.match(line) else "")
        lines.append(
            textwrap.fill(line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
        )
    return "\n".join(lines)


def count(n: int, noun: str) -> str:
    """Return a number with its noun, such as ``2 cameras``."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def say(text: str) -> None:
    """Print a line without wrapping it."""
    out.print(Text(as_flags(text)), soft_wrap=True)


def wrap_lines(text: str, indent: int) -> list[str]:
    """Return a text in lines of 80 columns, indented, those after the first by four more; no word is broken."""
    first, others = " " * indent, " " * (indent + 4)
    return textwrap.wrap(
        as_flags(text),
        _WIDTH,
        initial_indent=first,
        subsequent_indent=others,
        break_long_words=False,
        break_on_hyphens=False,
    )


def wrote(files: Sequence[str], folder: object, remark: str = "") -> None:
    """Print the names of written files and their folder in lines of 80 columns; no name is broken.

    Files of several people that differ in the name of the person are one word, such as ``2x.trc``, except with
    ``--verbose``.
    """
    files = files if detail.verbose else _grouped(files)
    words = [f"{name}," for name in files[:-1]] + list(files[-1:])
    lines = textwrap.wrap(" ".join(["Wrote", *words]), _WIDTH, break_long_words=False, break_on_hyphens=False)
    place = f"to {folder}"
    lines = [*lines[:-1], f"{lines[-1]} {place}"] if len(lines[-1]) + len(place) < _WIDTH else [*lines, place]
    for line in [*lines, *([remark] if remark else [])]:
        say(line)


def _grouped(files: Sequence[str]) -> list[str]:
    """Return the names of files, with one word for several that have the same ending but that of a table."""
    endings = [name[name.rfind(".") :] for name in files]
    often = {end for end in endings if end in _PERSON_ENDINGS and endings.count(end) > 1}
    words = [f"{endings.count(end)}x{end}" if end in often else name for name, end in zip(files, endings, strict=True)]
    return list(dict.fromkeys(words))


def print_time(seconds: float) -> None:
    """Print how long a command took, on a terminal and if that is more than a second."""
    if seconds > 1.0 and err.is_terminal:
        err.print(Text(f"Total time: {format_duration(seconds)}", "dim"))


def format_duration(seconds: float) -> str:
    """Return a duration, such as ``7.3 s``, ``2 min 05 s`` or ``1 h 02 min``."""
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    minutes = round(seconds) // 60
    return f"{minutes} min {round(seconds) % 60:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def percent(share: float) -> str:
    """Return a fraction in percent, or a dash if it is not finite."""
    return f"{100 * share:.1f} %" if math.isfinite(share) else "-"
