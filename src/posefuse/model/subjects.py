<<<<<<< HEAD
"""Tracks by range of frames, for stages that read detections per subject."""
=======
"""The assignment of detections to people, range of frames by range."""
>>>>>>> hub/main

from typing import Protocol

from posefuse.model.tracks import Tracks


class Subjects(Protocol):
<<<<<<< HEAD
    """Source of tracks, whatever the method that associates detections with subjects."""

    def tracks(self, start: int, stop: int) -> Tracks:
        """Return the tracks of the frames ``start`` to ``stop`` (counted from 0)."""
=======
    """Assigns detections to people."""

    def tracks(self, start: int, stop: int) -> Tracks:
        """Return the assignment in the frames ``start`` to ``stop`` (indices from 0)."""
>>>>>>> hub/main
        ...
