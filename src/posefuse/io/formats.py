"""What a file format is. The tables of those there are lie beside their readers, each as ``registry``."""

from dataclasses import dataclass
from importlib import import_module
from types import ModuleType


@dataclass(frozen=True)
class Format:
    """One file format.

    Attributes:
        name: what ``--format`` and messages call it.
        module: where it is read or written.
        reads: whether there is a reader.
        writes: whether there is a writer.
        files: what the files are called.
        conventions: units and axes in a line.
        lacks: what of a result's layer it has no place for; empty where it holds everything.
        suits: what a file beside a result is called, where one can be asked for by ``--also``.
    """

    name: str
    module: str
    reads: bool
    writes: bool
    files: str
    conventions: str
    lacks: str = ""
    suits: str = ""

    def load(self) -> ModuleType:
        """The format's module."""
        return import_module(self.module)


def by_name(formats: tuple[Format, ...], name: str) -> Format | None:
    """The format of that name, or None."""
    return next((form for form in formats if form.name == name), None)
