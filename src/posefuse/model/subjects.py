"""The assignment of detections to people, range of frames by range."""

from dataclasses import dataclass
from typing import Protocol

from posefuse.model.tracks import Tracks


class Subjects(Protocol):
    """Assigns detections to people."""

    def tracks(self, start: int, stop: int) -> Tracks:
        """Return the assignment in the frames ``start`` to ``stop`` (indices from 0)."""
        ...


@dataclass(frozen=True, eq=False)
class FixedSubjects:
    """A known assignment of detections to people."""

    recording_tracks: Tracks

    def tracks(self, start: int, stop: int) -> Tracks:
        """Return the assignment in a range of frames."""
        return self.recording_tracks.frames(start, stop)
