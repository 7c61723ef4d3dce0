"""Options and output of overlay videos."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from posefuse.model.options.options import LayerName

Matching = Literal["time", "frame"]


@dataclass(frozen=True)
class OverlayOptions:
    """Options of overlay videos.

    Attributes:
        layer: Layer to draw. Default: the best one.
        grid: Draw all cameras in one video instead of one video per camera.
        blank: Draw cameras without a video on a plain background.
        rescale: Accept videos with the aspect ratio but not the size of the calibration, as resized full images.
        match: Match images to frames by time, or image n to frame number n (from 0).
        start_s: Start time in the result.
        end_s: End time in the result (exclusive).
        offset_s: Start of each camera's video in the result's time. Default: 0.
    """

    layer: LayerName | None = None
    grid: bool = False
    blank: bool = False
    rescale: bool = False
    match: Matching = "time"
    start_s: float | None = None
    end_s: float | None = None
    offset_s: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class OverlayVideo:
    """An overlay video that was written.

    Attributes:
        path: Path of the file.
        n_images: Number of images.
        n_drawn: Number of images for which the result has a frame.
        notes: Notes for the user, in sentences.
    """

    path: Path
    n_images: int
    n_drawn: int
    notes: tuple[str, ...] = ()
