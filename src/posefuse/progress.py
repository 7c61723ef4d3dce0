"""How long calls say how far they are, without knowing who listens."""

from typing import Protocol


class Progress(Protocol):
    """Receives the progress of one long call; only the command line shows it."""

    def start(self, what: str, total: int) -> None:
        """A stage begins that has ``total`` units of work."""

    def advance(self, done: int) -> None:
        """``done`` more units are finished."""

    def finish(self) -> None:
        """The stage has ended."""


class Silent:
    """Nobody listens."""

    def start(self, what: str, total: int) -> None:
        """Ignore."""

    def advance(self, done: int) -> None:
        """Ignore."""

    def finish(self) -> None:
        """Ignore."""
