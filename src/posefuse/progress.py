"""The protocol by which long calls report their progress."""

from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar


class HasFrames(Protocol):
    """A range of frames."""

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        ...


Part = TypeVar("Part", bound=HasFrames)


class Progress(Protocol):
    """Receives the progress of one long call; the command line shows it."""

    def start(self, what: str, total: int) -> None:
        """Start a stage with ``total`` units of work."""

    def advance(self, done: int) -> None:
        """Add ``done`` finished units."""

    def finish(self) -> None:
        """End the stage."""

    def note(self, text: str) -> None:
        """Receive a remark that is not a warning, such as that work is resumed."""


class Silent:
    """Ignores all progress."""

    def start(self, what: str, total: int) -> None:
        """Ignore."""

    def advance(self, done: int) -> None:
        """Ignore."""

    def finish(self) -> None:
        """Ignore."""

    def note(self, text: str) -> None:
        """Ignore."""


def report_ranges(parts: Iterable[Part], n_frames: int, what: str, progress: Progress) -> Iterator[Part]:
    """Yield ranges of frames, and report each as done when the consumer asks for the next.

    Args:
        parts: consecutive ranges of frames.
        n_frames: number of frames of all ranges.
        what: name of the stage.
        progress: receives the progress.
    """
    progress.start(what, n_frames)
    for part in parts:
        n_part = part.n_frames
        yield part
        # The range must not stay in memory while the next one is computed.
        del part
        progress.advance(n_part)
    progress.finish()
