"""Findings of the recording check."""

from dataclasses import dataclass
from enum import StrEnum

from posefuse.arguments import checked


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
    INCOMPLETE = "incomplete check"


@checked
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
        """Return the sentence, its certainty, and the remedy."""
        return f"{self.sentence} ({100 * self.certainty:.0f} % certain) {self.remedy}"
