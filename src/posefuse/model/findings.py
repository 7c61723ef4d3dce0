"""Findings of the recording check."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from posefuse.arguments import checked
from posefuse.described import Described, Description, names


class FindingKind(StrEnum):
    """Enumerate the faults of a recording that the recording check can identify."""

    WRONG_CALIBRATION = "wrong calibration"
    SCALE = "scale"
    CAMERA_ORDER = "camera order"
    COPIED_POSE = "copied pose"
    IMAGE_TRANSFORM = "image rotated or resized"
    CAMERA_POSE = "camera pose"
    FOCAL_LENGTH = "focal length"
    LENS_DISTORTION = "lens distortion"
    TIME_OFFSET = "time offset"
    UNSYNCHRONIZED = "unsynchronized cameras"
    CLOCK_DRIFT = "clock drift"
    FRAME_RATE = "frame rate"
    DROPPED_FRAMES = "dropped frames"
    REPEATED_FRAMES = "repeated frames"
    LEFT_RIGHT_SWAP = "left/right swap"
    CONFIDENCE = "confidence"
    LOW_OVERLAP = "low overlap"
    INCOMPLETE = "incomplete check"


_CERTAIN = 0.95
_GROSS = (
    FindingKind.WRONG_CALIBRATION,
    FindingKind.SCALE,
    FindingKind.CAMERA_ORDER,
    FindingKind.COPIED_POSE,
    FindingKind.IMAGE_TRANSFORM,
)
"""Faults that make results wrong; a wrong focal length of all cameras is another one."""
POSE_FINDINGS = (
    FindingKind.WRONG_CALIBRATION,
    FindingKind.CAMERA_ORDER,
    FindingKind.COPIED_POSE,
    FindingKind.CAMERA_POSE,
    FindingKind.FOCAL_LENGTH,
    FindingKind.LENS_DISTORTION,
)
"""Findings that mean that the calibration is wrong."""
CLOCK_FINDINGS = (
    FindingKind.TIME_OFFSET,
    FindingKind.UNSYNCHRONIZED,
    FindingKind.CLOCK_DRIFT,
    FindingKind.FRAME_RATE,
    FindingKind.DROPPED_FRAMES,
)
"""Findings that mean that the times of a view are wrong."""


@checked
@dataclass(frozen=True, repr=False)
class Finding(Described):
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

    def _description(self) -> Description:
        rows = [("cameras", names(self.cameras) or "all"), ("what", self.sentence), ("remedy", self.remedy)]
        return Description(f"Finding: {self.kind}, certainty {100.0 * self.certainty:.0f} %", tuple(rows))

    @property
    def is_certain(self) -> bool:
        """Whether results are wrong beyond doubt: a gross fault, and no other explanation.

        Small faults, which only make results less accurate, and faults that a command corrects or avoids, do not count.
        """
        gross = self.kind in _GROSS or (self.kind is FindingKind.FOCAL_LENGTH and not self.cameras)
        return gross and self.certainty >= _CERTAIN

    def __str__(self) -> str:
        """Return the sentence, its certainty, and the remedy."""
        return f"{self.sentence} ({100 * self.certainty:.0f} % certain) {self.remedy}"


def certain_faults(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return the findings that make results wrong beyond doubt."""
    return tuple(finding for finding in findings if finding.is_certain)


def verdict_sentences(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Return which poses and clocks are wrong, or that none is: the verdict that commands and reports present."""
    about = [finding for finding in findings if finding.kind in (*POSE_FINDINGS, *CLOCK_FINDINGS)]
    if not about:
        return ("the recording shows no wrong camera pose and no wrong clock",)
    return tuple(f"{finding.kind}: {finding.sentence}" for finding in about)
