"""What is a range of frames' own in a result: what is kept of it while the rest of a long recording is made."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.model.label_swaps import Swaps
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.track_events import Poses
from posefuse.model.tracks import Tracks


@dataclass(frozen=True, eq=False)
class Piece:
    """A range of frames of a result, without what all ranges share; fields are those of :class:`Reconstruction`."""

    frame_numbers: np.ndarray
    time_s: np.ndarray
    layers: dict[str, Layer]
    tracks: Tracks | None
    swaps: Swaps | None
    poses: Poses | None

    @classmethod
    def of(cls, part: Reconstruction) -> "Piece":
        """A range of frames."""
        return cls(part.frame_numbers, part.time_s, dict(part.layers), part.tracks, part.swaps, part.poses)

    def of_result(self, other: Reconstruction) -> Reconstruction:
        """The range, with what it shares with another of the same result."""
        return replace(
            other,
            frame_numbers=self.frame_numbers,
            time_s=self.time_s,
            layers=self.layers,
            tracks=self.tracks,
            swaps=self.swaps,
            poses=self.poses,
        )
