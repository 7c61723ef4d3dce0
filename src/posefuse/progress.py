"""How long calls say how far they are, without knowing who listens."""

from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar


class HasFrames(Protocol):
    """A range of frames of something."""

    @property
    def n_frames(self) -> int:
        """How many."""
        ...


Part = TypeVar("Part", bound=HasFrames)


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


def watched(parts: Iterable[Part], n_frames: int, what: str, progress: Progress) -> Iterator[Part]:
    """The same ranges of frames, each told to ``progress`` once whoever asked for it is done with it."""
    progress.start(what, n_frames)
    for part in parts:
        yield part
        progress.advance(part.n_frames)
    progress.finish()
