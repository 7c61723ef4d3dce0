"""Format help: ``--help`` shows the options people use on one screen, ``--help-all`` shows every option."""

import textwrap
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from cyclopts.help import HelpEntry, HelpPanel
from rich.console import Console, ConsoleOptions
from rich.text import Text

if TYPE_CHECKING:
    from posefuse.model.options.catalog import OptionEntry

OPTIONS_GROUP = "Options"
"""Title of the group of flags that set fields of the options record."""

RECONSTRUCTION_GROUP = "Options of the reconstruction"
"""Title of the same group in a command that has many other flags."""

_MOST_COMMON = ("people", "bodies", "pick", "person", "skeleton", "up", "solve", "align.floor")
"""Options that such a command shows."""

VIDEOS_GROUP = "Calibration, and options with --from-videos"
"""Options of a run from videos, of which the help of a batch shows the most common ones."""
_COMMON_WITH_VIDEOS = frozenset({"--detector", "--weights", "--stature-m", "--calibration", "--board"})

STREAM_GROUP = "Stream"
"""Title of the group of flags that set fields of the stream options."""

_MIN_LABEL, _MAX_LABEL = 16, 32


class HelpFormatter:
    """Print help as two columns: names, and what they do.

    Attributes:
        show_all: Whether to show every option with its full text, range and choices.
    """

    def __init__(self) -> None:
        self.show_all = False

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Print a group of entries."""
        entries = [entry for entry in panel.entries if self._is_shown(panel, entry)]
        if not entries:
            return
        title = Text.from_ansi(_plain(console, panel.title))
        title.stylize("bold")
        console.print(title)
        labels = [
            _label(entry, self.show_all or str(panel.title) not in (OPTIONS_GROUP, RECONSTRUCTION_GROUP))
            for entry in entries
        ]
        fitting = [len(label) for label in labels if len(label) <= _MAX_LABEL]
        width = max([_MIN_LABEL, *fitting])
        for entry, label in zip(entries, labels, strict=True):
            _print_entry(console, options.max_width, label, self._text(console, panel, entry), width)
        hidden = len(panel.entries) - len(entries)
        if hidden:
            console.print(Text(f"  ... and {hidden} more: --help-all lists them, docs/options.md explains them."))

    def _is_shown(self, panel: HelpPanel, entry: HelpEntry) -> bool:
        if self.show_all:
            return True
        if str(panel.title) == VIDEOS_GROUP:
            return not _COMMON_WITH_VIDEOS.isdisjoint(entry.positive_names)
        option = _option_of(panel, entry)
        if option is not None and str(panel.title) == RECONSTRUCTION_GROUP:
            return option.name in _MOST_COMMON
        return not any("." in name for name in entry.positive_names) if option is None else option.bounds.common

    def _text(self, console: Console, panel: HelpPanel, entry: HelpEntry) -> str:
        option = _option_of(panel, entry)
        text = _plain(console, entry.description)
        if option is None:
            brackets = [", ".join(entry.choices)] if entry.choices else []
        elif self.show_all:
            text, brackets = option.text.replace("`", ""), [option.expected]
        else:
            text, brackets = option.sentence.replace("`", ""), []
        if entry.default not in (None, "False"):
            brackets.append(f"default {entry.default}")
        if entry.required:
            brackets.append("required")
        return f"{text} [{'; '.join(brackets)}]" if brackets else text

    def render_usage(self, console: Console, options: ConsoleOptions, usage: Any) -> None:
        """Print the usage line."""
        text = _plain(console, usage)
        if text:
            console.print(Text(text if text.startswith("Usage:") else f"Usage: {text}"))
            console.print()

    def render_description(self, console: Console, options: ConsoleOptions, description: Any) -> None:
        """Print what a command does; ``--help`` shows the first paragraph."""
        paragraphs = [part for part in _plain(console, description).split("\n\n") if part.strip()]
        for paragraph in paragraphs if self.show_all else paragraphs[:2]:
            for line in textwrap.wrap(paragraph, options.max_width, break_on_hyphens=False):
                console.print(Text(line), soft_wrap=True)
            console.print()


def _option_of(panel: HelpPanel, entry: HelpEntry) -> "OptionEntry | None":
    """Return the option of a reconstruction or a stream that a help entry describes, or None."""
    if str(panel.title) not in (OPTIONS_GROUP, RECONSTRUCTION_GROUP, STREAM_GROUP):
        return None
    for name in entry.positive_names:
        option = _entries().get(name.removeprefix("--").replace("-", "_"))
        if option is not None:
            return option
    return None


@cache
def _entries() -> "dict[str, OptionEntry]":
    """Return the options of a reconstruction and of a stream by name."""
    # Imported here, because the list of commands needs no options, and the records load NumPy.
    from posefuse.model.options.catalog import list_options
    from posefuse.model.options.options import Options
    from posefuse.model.options.stream import StreamOptions

    return {option.name: option for record in (StreamOptions, Options) for option in list_options(record)}


def _label(entry: HelpEntry, with_metavar: bool) -> str:
    """Return the names of an entry as help shows them, such as ``-o, --output PATH``."""
    names: Sequence[str] = (*entry.positive_shorts, *entry.positive_names)
    if entry.positional_label:
        return str(entry.positional_label)
    label = ", ".join(names)
    return f"{label} {entry.metavar}" if entry.metavar and with_metavar else label


def _print_entry(console: Console, width: int, label: str, text: str, column: int) -> None:
    indent = " " * (column + 4)
    lines = textwrap.wrap(text, max(width - len(indent), 24), break_long_words=False, break_on_hyphens=False) or [""]
    if len(label) > column:
        console.print(Text(f"  {label}"), soft_wrap=True)
        first = indent
    else:
        first = f"  {label:<{column}}  "
    for number, line in enumerate(lines):
        console.print(Text((first if number == 0 else indent) + line), soft_wrap=True)


def _plain(console: Console, value: Any) -> str:
    """Return what rich would print of a value, without styles."""
    if value is None:
        return ""
    if isinstance(value, str | Text):
        return str(value).replace("`", "").strip()
    plain = Console(width=10_000, force_terminal=False, no_color=True, highlight=False)
    with plain.capture() as capture:
        plain.print(value, end="")
    return "\n".join(line.rstrip() for line in capture.get().splitlines()).replace("`", "").strip()
