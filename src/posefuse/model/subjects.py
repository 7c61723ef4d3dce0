"""The assignment of detections to people, range of frames by range."""

from typing import Protocol

from posefuse.model.tracks import Tracks


class Subjects(Protocol):
    """Assigns detections to people."""

    def tracks(self, start: int, stop: int) -> Tracks:
        """Return the assignment in the frames ``start`` to ``stop`` (indices from 0)."""
        ...
