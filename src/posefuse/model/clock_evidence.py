"""Evidence on the clocks of views, by source."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

EvidenceSource = Literal["timestamps", "timecode", "creation time", "sound", "keypoints"]


@dataclass(frozen=True)
class ClockEvidence:
    """What one source shows about the clock of one view.

    Attributes:
        view: name of the view.
        source: the source.
        offset_s: true time minus timestamp at the view's time 0, on a clock that all evidence shares; NaN without
            evidence.
        sd_s: standard deviation of the offset with its systematic part; NaN without evidence.
        drift_ppm: rate at which the offset grows.
        reason: what the offset rests on, or why there is none; one sentence.
    """

    view: str
    source: EvidenceSource
    offset_s: float
    sd_s: float
    drift_ppm: float
    reason: str

    @property
    def is_decisive(self) -> bool:
        """Whether the source determines the offset."""
        return bool(np.isfinite(self.offset_s))
