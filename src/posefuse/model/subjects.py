"""Whose detections are whose, for stages that ask by range of frames."""

from typing import Protocol

from posefuse.model.tracks import Tracks


class Subjects(Protocol):
    """Answers who is followed, however that was found."""

    def tracks(self, start: int, stop: int) -> Tracks:
        """Who is whose in the frames ``start`` to ``stop`` (counted from 0)."""
        ...
