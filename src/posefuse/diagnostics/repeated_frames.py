"""Find views that repeat frames."""

import numpy as np

from posefuse.diagnostics.examination import Examination
from posefuse.model.findings import Finding, FindingKind

_MIN_POINTS, _MIN_FRAMES, _MIN_SHARE = 4, 4, 0.01


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return a finding for each view in which detections of consecutive frames are exactly equal."""
    observations = examination.detected
    current, previous = observations.pixels[1:], observations.pixels[:-1]
    seen = np.isfinite(current[..., 0]) & np.isfinite(previous[..., 0])
    comparable = seen.sum(axis=-1) >= _MIN_POINTS
    equal = ((current == previous).all(axis=-1) | ~seen).all(axis=-1)
    repeated = comparable & equal & (np.diff(observations.runs) == 0)[:, None]
    total, count = comparable.sum(axis=0), repeated.sum(axis=0)
    # A subject at rest on integer pixels repeats in all views.
    still = count.min() if len(count) > 1 else 0
    out = []
    for v, name in enumerate(observations.rig.names):
        share = count[v] / max(int(total[v]), 1)
        if count[v] - still < _MIN_FRAMES or share < _MIN_SHARE:
            continue
        frames = observations.frame_numbers[1:][repeated[:, v]]
        sentence = (
            f"View {name!r} repeats frames: the detections of {count[v]} of {total[v]} frames ({100 * share:.1f} %) "
            f"equal those of the previous frame exactly; the first is frame {frames[0]}."
        )
        remedy = "The video probably filled dropped frames. Record again, or use the camera's own timestamps."
        span, gain = (int(frames[0]), int(frames[-1])), 100.0 * share
        kind = FindingKind.REPEATED_FRAMES
        out.append(Finding(kind, (name,), span, float(share), "share", np.nan, 0.98, gain, sentence, remedy))
    return tuple(out)
