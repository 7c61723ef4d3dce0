"""Records of what the recording check finds."""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np


class FindingKind(StrEnum):
    """Enumerate the faults of a recording that the recording check can identify."""

    WRONG_CALIBRATION = "wrong calibration"
    CAMERA_ORDER = "camera order"
    COPIED_POSE = "copied pose"
    IMAGE_TRANSFORM = "image rotated or resized"
    CAMERA_POSE = "camera pose"
    FOCAL_LENGTH = "focal length"
    LENS_DISTORTION = "lens distortion"
    TIME_OFFSET = "time offset"
    CLOCK_DRIFT = "clock drift"
    DROPPED_FRAMES = "dropped frames"
    REPEATED_FRAMES = "repeated frames"
    LEFT_RIGHT_SWAP = "left/right swap"
    CONFIDENCE = "confidence"
    LOW_OVERLAP = "low overlap"


NOTE_PREFIX = "Recording check: "
"""Prefix of the notes of a result that are findings of the recording check."""


@dataclass(frozen=True)
class Finding:
    """Describe one fault of a recording.

    Attributes:
        kind: type of the fault.
        cameras: names of the affected cameras; empty if all are affected.
        frames: numbers of the first and the last affected frame, or None if all are affected.
        size: magnitude of the fault, NaN where it has none.
        unit: unit of the size.
        sd: standard deviation of the size, NaN where unknown.
        certainty: probability from 0 to 1 that this fault and no other is present.
        gain: improvement of the log-likelihood once the fault is corrected; findings are ranked by it.
        sentence: description for the user.
        remedy: recommended action.
    """

    kind: FindingKind
    cameras: tuple[str, ...]
    frames: tuple[int, int] | None
    size: float
    unit: str
    sd: float
    certainty: float
    gain: float
    sentence: str
    remedy: str

    def __str__(self) -> str:
        """Return the description, its certainty, and the remedy."""
        return f"{self.sentence} ({100 * self.certainty:.0f} % certain) {self.remedy}"


def rank_findings(findings: list[Finding]) -> tuple[Finding, ...]:
    """Return findings in order of decreasing gain."""
    return tuple(sorted(findings, key=lambda f: (-f.gain, f.kind, f.cameras)))


def certainty_of(score: float, competitors: list[float]) -> float:
    """Return the certainty of a hypothesis from its penalized gain and those of its competitors."""
    present = 1.0 / (1.0 + math.exp(-0.5 * min(max(score - 10.0, -60.0), 60.0)))
    preferred = 1.0 / (1.0 + sum(math.exp(min(0.5 * (competitor - score), 0.0)) for competitor in competitors))
    return float(np.clip(present * preferred, 0.0, 0.99))
