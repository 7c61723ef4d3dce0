"""Tracks by range of frames, for stages that read detections per subject."""

from typing import Protocol

from posefuse.model.tracks import Tracks


class Subjects(Protocol):
    """Source of tracks, whatever the method that associates detections with subjects."""

    def tracks(self, start: int, stop: int) -> Tracks:
        """Return the tracks of the frames ``start`` to ``stop`` (counted from 0)."""
        ...
