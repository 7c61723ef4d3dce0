"""What a health check finds, as records."""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np


class Kind(StrEnum):
    """What can be wrong with a recording."""

    RIG = "another calibration"
    ORDER = "camera order"
    COPY = "copied pose"
    IMAGE = "image turned or resized"
    POSE = "camera pose"
    FOCAL = "focal length"
    LENS = "lens"
    LATE = "out of step"
    DRIFT = "clock drift"
    DROPPED = "frames dropped"
    REPEATED = "frames repeated"
    SIDES = "left and right"
    CONFIDENCE = "confidence"
    OVERLAP = "little overlap"


HEALTH = "Health: "
"""What a note of a result begins with that is a finding."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong with a recording.

    Attributes:
        kind: what.
        cameras: names of the cameras that have it; empty where all do.
        frames: numbers of the first and the last frame that have it, or None where all do.
        size: how much of it, NaN where it has no size.
        unit: of the size.
        sd: standard deviation of the size, NaN where it is not known.
        certainty: 0 to 1, that this is wrong and nothing else.
        gain: how much better the views agree with it mended, as a gain in log-likelihood: what findings rank by.
        sentence: what is wrong, for people.
        remedy: what to do about it.
    """

    kind: Kind
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
        """The sentence, how certain it is, and the remedy."""
        return f"{self.sentence} ({100 * self.certainty:.0f} % certain) {self.remedy}"


def ranked(findings: list[Finding]) -> tuple[Finding, ...]:
    """Those that spoil most first."""
    return tuple(sorted(findings, key=lambda f: (-f.gain, f.kind, f.cameras)))


def certainty_of(score: float, rivals: list[float]) -> float:
    """How certain a hypothesis is whose penalised gain is ``score``, beside those of others as good."""
    wrong = 1.0 / (1.0 + math.exp(-0.5 * min(max(score - 10.0, -60.0), 60.0)))
    share = 1.0 / (1.0 + sum(math.exp(min(0.5 * (rival - score), 0.0)) for rival in rivals))
    return float(np.clip(wrong * share, 0.0, 0.99))
