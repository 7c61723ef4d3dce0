"""List every option with its name, type, default, bounds and help text.

The command line's help, the file of ``posefuse init`` and ``docs/options.md`` are written from this list.
"""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from docstring_parser import parse

from posefuse.model.options.bounds import Bounds, bounds_of, expected_text, field_hints, without_none
from posefuse.model.options.options import Options


@dataclass(frozen=True)
class OptionEntry:
    """One option of a record.

    Attributes:
        name: Dotted name, such as ``triangulation.min_views``.
        text: Help text.
        hint: Type.
        bounds: Declared bounds.
        default: Default value; None or an empty tuple if the option is not set.
    """

    name: str
    text: str
    hint: Any
    bounds: Bounds
    default: Any

    @property
    def table(self) -> str:
        """Name of the table that holds the option; empty at the top level."""
        return self.name.rpartition(".")[0]

    @property
    def key(self) -> str:
        """Name of the option in its table."""
        return self.name.rpartition(".")[2]

    @property
    def flag(self) -> str:
        """Flag of the option on the command line."""
        return f"--{self.name.replace('_', '-')}"

    @property
    def is_unset(self) -> bool:
        """Whether the option has no value by default."""
        return self.default is None or self.default == ()

    @property
    def sentence(self) -> str:
        """First sentence of the help text."""
        head, stop, _ = self.text.partition(". ")
        return f"{head}." if stop else self.text

    @property
    def expected(self) -> str:
        """Valid values, such as ``a finite number above 0 s``."""
        return expected_text(self.hint, self.bounds)

    @property
    def default_text(self) -> str:
        """Default value as help shows it; empty if the option is not set."""
        if self.is_unset:
            return ""
        if isinstance(self.default, bool):
            return str(self.default).lower()
        if isinstance(self.default, tuple):
            return ", ".join(str(item) for item in self.default)
        if isinstance(self.default, float):
            return f"{self.default:.10g}" if math.isfinite(self.default) else str(self.default)
        return str(self.default)


def list_options(record: type = Options, prefix: str = "") -> Iterator[OptionEntry]:
    """Yield every option of a record and of the records in it, options before tables.

    Args:
        record: Options record.
        prefix: Table that holds the record, with its dot, such as ``tracker.``.
    """
    hints, texts, tables = field_hints(record), help_texts(record), []
    for field in dataclasses.fields(record):
        inner = without_none(hints[field.name])
        if dataclasses.is_dataclass(inner):
            tables.append((field.name, inner))
            continue
        text = texts.get(field.name, "")
        yield OptionEntry(f"{prefix}{field.name}", text, hints[field.name], bounds_of(field), field.default)
    for name, inner in tables:
        yield from list_options(inner, f"{prefix}{name}.")


@cache
def options_by_name() -> dict[str, OptionEntry]:
    """Return every option of a reconstruction by its dotted name."""
    return {entry.name: entry for entry in list_options()}


@cache
def help_texts(record: type) -> dict[str, str]:
    """Return the help text of every attribute of a record, from its docstring."""
    return {
        parameter.arg_name: " ".join((parameter.description or "").split())
        for parameter in parse(record.__doc__ or "").params
    }
