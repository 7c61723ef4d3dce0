"""A range of frames of a result, without what all ranges share; the unit that checkpoints store."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.model.label_swaps import Swaps
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.track_events import Poses
from posefuse.model.tracks import Tracks


@dataclass(frozen=True, eq=False)
class FrameRange:
    """The per-frame fields of a :class:`Reconstruction`."""

    frame_numbers: np.ndarray
    time_s: np.ndarray
    layers: dict[str, Layer]
    tracks: Tracks | None
    swaps: Swaps | None
    poses: Poses | None

    @classmethod
    def of(cls, part: Reconstruction) -> "FrameRange":
        """Return the per-frame fields of a range of frames."""
        return cls(part.frame_numbers, part.time_s, dict(part.layers), part.tracks, part.swaps, part.poses)

    def to_reconstruction(self, other: Reconstruction) -> Reconstruction:
        """Return the range with the fields that it shares with another range of the same result."""
        return replace(
            other,
            frame_numbers=self.frame_numbers,
            time_s=self.time_s,
            layers=self.layers,
            tracks=self.tracks,
            swaps=self.swaps,
            poses=self.poses,
        )
