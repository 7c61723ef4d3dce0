"""The description shared by all file formats, and the registry that finds and loads them.

Each format is one module that defines one constant ``FORMAT``: how the format is recognized, read, written and
documented. The registries of :mod:`posefuse.io.calibration`, :mod:`posefuse.io.keypoints` and
:mod:`posefuse.io.results` name the modules. A module is imported when its format is first needed.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Generic, TypeVar


@dataclass(frozen=True, kw_only=True)
class Format(ABC):
    """One file format.

    Attributes:
        name: Name of the format in ``--format``, ``--to`` and messages.
        files: Names or patterns of its files.
        conventions: Units, axes and limits, in one line.
        recognized_by: Content by which a path is recognized, for ``posefuse inspect``. Default: ``files``.
        endings: Endings of file names that select this format for writing.
    """

    name: str
    files: str
    conventions: str
    recognized_by: str = ""
    endings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Fill in the default of ``recognized_by``."""
        object.__setattr__(self, "recognized_by", self.recognized_by or self.files)

    @property
    @abstractmethod
    def reads(self) -> bool:
        """Whether posefuse reads the format."""

    @property
    @abstractmethod
    def writes(self) -> bool:
        """Whether posefuse writes the format."""


AnyFormat = TypeVar("AnyFormat", bound=Format)


class FormatRegistry(Generic[AnyFormat]):
    """The formats of one package, in the order in which their readers are tried.

    Iterating imports one module at a time, so that a search that ends early imports no more than it needs.
    """

    def __init__(self, kind: type[AnyFormat], package: str, modules: tuple[str, ...]) -> None:
        """Name the formats without importing them.

        Args:
            kind: Type of each module's ``FORMAT``.
            package: Package of the modules.
            modules: Names of the modules in the package, one per format.
        """
        self._kind = kind
        self._package = package
        self._modules = modules

    def __iter__(self) -> Iterator[AnyFormat]:
        """Import the modules one by one and yield their formats."""
        for module in self._modules:
            form = import_module(f"{self._package}.{module}").FORMAT
            assert isinstance(form, self._kind), f"{self._package}.{module}.FORMAT is not a {self._kind.__name__}"
            yield form

    def find(self, name: str | None) -> AnyFormat | None:
        """Return the format with this name, or None if there is none."""
        return next((form for form in self if form.name == name), None)

    def find_written(self, name: str) -> AnyFormat | None:
        """Return the format with this name, or None if there is none or posefuse does not write it."""
        return next((form for form in self if form.name == name and form.writes), None)

    def written(self) -> tuple[AnyFormat, ...]:
        """Return the formats that posefuse writes."""
        return tuple(form for form in self if form.writes)
