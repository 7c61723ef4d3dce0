"""What long work keeps of itself, so that the same work goes on from there after it was ended, however it was."""

from pathlib import Path
from typing import Any, Protocol


class Spool(Protocol):
    """Takes values that are needed again later, and not now."""

    def add(self, value: Any) -> int:
        """Take a value; its place."""
        ...

    def read(self, place: int) -> Any:
        """The value at a place."""
        ...


class Keeper(Protocol):
    """Keeps finished parts of one piece of work by name."""

    @property
    def keeps(self) -> bool:
        """Whether anything is kept at all."""
        ...

    def has(self, name: str) -> bool:
        """Whether a part of that name was kept."""
        ...

    def get(self, name: str) -> Any:
        """The part of that name, None where there is none."""
        ...

    def put(self, name: str, value: Any) -> Any:
        """Keep a part, in place of one of that name; the part as :meth:`get` gives it.

        Work that goes on with what this returns does not differ from work that goes on after it was ended.
        """
        ...

    def spool(self, name: str) -> Spool | None:
        """Room for what parts refer to: what was added to it before the last part was kept is there again."""
        ...

    def within(self, name: str) -> "Keeper":
        """A keeper of a part of the work, whose names are its own."""
        ...

    def keep_file(self, file: Path, said: tuple[str, ...] = ()) -> None:
        """Keep a finished file instead of all parts, and what was said while it was made."""
        ...

    def take_file(self, target: Path) -> tuple[str, ...] | None:
        """Put the file that is kept at a place; what was said while it was made, None if none is there and whole."""
        ...


class KeepsNothing:
    """Work is done in one go."""

    keeps = False

    def has(self, name: str) -> bool:
        """Nothing is."""
        return False

    def get(self, name: str) -> Any:
        """Nothing."""

    def put(self, name: str, value: Any) -> Any:
        """The same part."""
        return value

    def spool(self, name: str) -> Spool | None:
        """None: what is spooled is gone when the work is."""

    def within(self, name: str) -> Keeper:
        """The same."""
        return self

    def keep_file(self, file: Path, said: tuple[str, ...] = ()) -> None:
        """Nothing."""

    def take_file(self, target: Path) -> tuple[str, ...] | None:
        """None is there."""


NOTHING = KeepsNothing()
