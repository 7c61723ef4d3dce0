"""Findings of the recording check."""

from dataclasses import dataclass
from enum import StrEnum


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


@dataclass(frozen=True)
class Finding:
    """One problem of a recording.

    Attributes:
        kind: kind of problem.
        cameras: names of the affected cameras; empty if all are.
        frames: numbers of the first and last affected frame, or None if all frames are affected.
        size: magnitude of the problem in ``unit``, NaN where it has none.
        unit: unit of ``size``.
        sd: standard deviation of ``size``, NaN where unknown.
        certainty: probability, 0 to 1, that this problem and no other explains the disagreement.
        gain: gain in log-likelihood when the problem is corrected; findings are ranked by it.
        sentence: description for users.
        remedy: what the user can do about it.
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
        """Return the sentence, its certainty, and the remedy."""
        return f"{self.sentence} ({100 * self.certainty:.0f} % certain) {self.remedy}"
