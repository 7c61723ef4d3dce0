"""Is the calibration of another rig, or of another day?"""

from typing import TYPE_CHECKING

import numpy as np

from posefuse.diagnostics.findings import Finding, Kind

if TYPE_CHECKING:
    from posefuse.diagnostics.examine import Examination


def find(examination: "Examination") -> tuple[Finding, ...]:
    """Said where hardly any two views agree, and no order, turn or size of images mends it."""
    coarse = examination.coarse
    if coarse is None or coarse.agreed:
        return ()
    level = float(np.nanmedian(coarse.first)) if np.isfinite(coarse.first).any() else np.nan
    if not np.isfinite(level):
        return ()
    names = examination.evidence.rig.names
    if len(names) == 2:
        sentence = f"Cameras {names[0]!r} and {names[1]!r} do not agree; with two there is no telling which is wrong."
    else:
        sentence = "The cameras do not agree, hardly any two of them; no order, turn or size of their images mends it."
    remedy = "The calibration is probably of another rig or another day. Look for the right one, or calibrate again."
    certainty = float(np.clip(level, 0.5, 0.97))
    return (Finding(Kind.RIG, (), None, level, "disagreement", np.nan, certainty, 2000.0, sentence, remedy),)
