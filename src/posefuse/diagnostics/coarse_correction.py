"""Corrections of gross faults, and the choice among them."""

from collections.abc import Sequence
from dataclasses import dataclass

from posefuse.diagnostics.recording_model import RecordingModel

MIN_GAIN = 0.05
"""Improvement that a correction must bring."""
_MIN_IMAGE_GAIN = 0.2
"""Improvement that a turned, mirrored or resized image must bring."""
_EQUAL_GAIN = 0.02


@dataclass(frozen=True)
class CoarseCorrection:
    """Describe one gross fault and its correction.

    Attributes:
        kind: ``image``, ``swap``, ``offset``, ``rate``, ``focal``, ``order`` or ``pose``.
        view: index of the view; -1 if all views are affected or several exchange cameras.
        model: recording model with the correction.
        before: disagreement of the view with the others before the correction, 0 to 1.
        after: disagreement after it.
        rate_error: relative error of the frame rate; 0 for other kinds.
    """

    kind: str
    view: int
    model: RecordingModel
    before: float
    after: float
    rate_error: float = 0.0

    @property
    def score(self) -> float:
        """Return the improvement on the scale of a penalized gain of the fine search."""
        return 400.0 * (self.before - self.after)


def choose(corrections: Sequence[CoarseCorrection], level: float) -> CoarseCorrection | None:
    """Return the correction that leaves the least disagreement; among equals the simplest, which comes first."""
    with_requirement = [
        (g, max(_MIN_IMAGE_GAIN if g.kind == "image" else MIN_GAIN, 0.5 * (g.before - level))) for g in corrections
    ]
    helpful = [g for g, required in with_requirement if g.before - g.after > required]
    if not helpful:
        return None
    largest = max(g.before - g.after for g in helpful)
    return next(g for g in helpful if g.before - g.after > largest - _EQUAL_GAIN)
