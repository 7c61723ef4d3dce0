"""How videos are drawn on, and what came out."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from posefuse.model.options.options import LayerName

Matching = Literal["time", "frame"]


@dataclass(frozen=True)
class OverlayOptions:
    """How videos are drawn on.

    Attributes:
        layer: which points; the best there is by default.
        grid: all cameras in one video, instead of one video a camera.
        blank: cameras without a video are drawn on a plain background.
        rescale: a video of another size than the calibration, but of its shape, is taken for the whole image.
        match: pictures belong to frames by their times, or the n-th picture to frame number n (from 0).
        start_s: time in the result to begin at.
        end_s: time in the result to end before.
        offset_s: camera to the result's time at which its video begins; 0 for those not named.
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
class Written:
    """A video that was written.

    Attributes:
        path: of the file.
        n_images: pictures in it.
        n_drawn: of these, pictures to which the result has a frame.
        remarks: what is worth saying of it, in sentences.
    """

    path: Path
    n_images: int
    n_drawn: int
    remarks: tuple[str, ...] = ()
