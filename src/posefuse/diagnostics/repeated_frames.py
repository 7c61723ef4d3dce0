"""Does a view repeat frames?"""

from typing import TYPE_CHECKING

import numpy as np

from posefuse.diagnostics.findings import Finding, Kind

if TYPE_CHECKING:
    from posefuse.diagnostics.examine import Examination

_FEWEST_POINTS, _FEWEST_FRAMES, _SHARE = 4, 4, 0.01


def find(examination: "Examination") -> tuple[Finding, ...]:
    """Views in which frames are, to the last digit, the frame before."""
    evidence = examination.seen
    now, before = evidence.pixels[1:], evidence.pixels[:-1]
    seen = np.isfinite(now[..., 0]) & np.isfinite(before[..., 0])
    shown = seen.sum(axis=-1) >= _FEWEST_POINTS
    same = shown & ((now == before).all(axis=-1) | ~seen).all(axis=-1) & (np.diff(evidence.runs) == 0)[:, None]
    total, again = shown.sum(axis=0), same.sum(axis=0)
    # A subject that keeps still on integer pixels repeats in all views.
    still = again.min() if len(again) > 1 else 0
    out = []
    for v, name in enumerate(evidence.rig.names):
        share = again[v] / max(int(total[v]), 1)
        if again[v] - still < _FEWEST_FRAMES or share < _SHARE:
            continue
        at = evidence.frame_numbers[1:][same[:, v]]
        sentence = (
            f"View {name!r} repeats frames: {again[v]} of {total[v]} ({100 * share:.1f} %) are the frame before to the "
            f"last digit, the first of them frame {at[0]}."
        )
        remedy = "Its video dropped frames and was filled up. Record again, or use the camera's own time stamps."
        span = (int(at[0]), int(at[-1]))
        out.append(
            Finding(Kind.REPEATED, (name,), span, float(share), "share", np.nan, 0.98, 100.0 * share, sentence, remedy)
        )
    return tuple(out)
