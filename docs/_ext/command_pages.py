"""Write one page for each command, from the help that the command line itself prints.

The pages are written into docs/generated/commands, which git ignores.
"""

import io
from pathlib import Path
from typing import Any

from cyclopts.help import HelpPanel
from rich.console import Console, ConsoleOptions
from sphinx.application import Sphinx

from posefuse.cli.help import HelpFormatter
from posefuse.cli.main import COMMANDS
from posefuse.cli.main import app as command_line


class _PageFormatter(HelpFormatter):
    """Collects what help shows as reStructuredText, with every option and its full text."""

    def __init__(self) -> None:
        super().__init__()
        self.show_all = True
        self.parts: list[str] = []

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Add a group of entries."""
        if not panel.entries:
            return
        title = _plain(panel.title)
        self.parts += [title, "-" * len(title), ""]
        for entry in panel.entries:
            names = [*entry.positive_shorts, *entry.positive_names] or [str(entry.positional_label)]
            if entry.positional_label:
                names = [str(entry.positional_label)]
            label = ", ".join(f"``{name}``" for name in names)
            self.parts += [label, f"    {_escaped(' '.join(self._text(console, panel, entry).split()))}", ""]

    def render_usage(self, console: Console, options: ConsoleOptions, usage: Any) -> None:
        """Add the usage line."""
        text = _plain(usage).removeprefix("Usage:").strip()
        if text:
            self.parts += [".. code-block:: sh", "", f"   {text}", ""]

    def render_description(self, console: Console, options: ConsoleOptions, description: Any) -> None:
        """Add what the command does."""
        for paragraph in _plain(description).split("\n\n"):
            self.parts += [_escaped(" ".join(paragraph.split())), ""]


def _plain(value: Any) -> str:
    with (console := Console(width=10_000, no_color=True, highlight=False, file=io.StringIO())).capture() as capture:
        console.print(value if value is not None else "", end="")
    return capture.get().strip()


def _escaped(text: str) -> str:
    for character in "\\`*_|":
        text = text.replace(character, f"\\{character}")
    return text


def page_of(name: str) -> str:
    """Return the page of a command."""
    page = _PageFormatter()
    before = command_line.help_formatter
    command_line.help_formatter = page
    try:
        command_line.help_print([name], console=Console(file=io.StringIO(), width=10_000))
    finally:
        command_line.help_formatter = before
    title = f"posefuse {name}"
    return "\n".join([title, "=" * len(title), "", *page.parts])


def write_pages(app: Sphinx) -> None:
    """Write the index and the pages; pages that have not changed keep their time."""
    folder = Path(app.srcdir) / "generated" / "commands"
    folder.mkdir(parents=True, exist_ok=True)
    pages = {f"{name}.rst": page_of(name) for name in COMMANDS}
    pages["index.rst"] = _index()
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")


def _index() -> str:
    rows = [line for name, text in COMMANDS.items() for line in (f"   * - :doc:`{name}`", f"     - {_escaped(text)}")]
    return "\n".join([
        "Commands", "========", "",
        "``posefuse COMMAND --help`` shows the common flags of a command, ``--help-all`` shows all. Flags that set",
        "options are explained with their defaults and ranges under :doc:`options </options>`.", "",
        ".. list-table::", "   :widths: 25 75", "", *rows, "",
        ".. toctree::", "   :hidden:", "", *(f"   {name}" for name in COMMANDS), "",
    ])  # fmt: skip


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the pages."""
    app.connect("builder-inited", write_pages, priority=400)
    return {"parallel_read_safe": True}
