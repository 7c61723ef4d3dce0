"""Find calibrations that belong to another camera setup or another day."""

import numpy as np

from posefuse.diagnostics.coarse_search import AGREES
from posefuse.diagnostics.examination import Examination
from posefuse.model.findings import Finding, FindingKind


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return a finding if hardly any two views agree and no single correction makes them agree."""
    coarse = examination.coarse
    if coarse is None or coarse.views_agree:
        return ()
    level = float(np.nanmedian(coarse.initial_table)) if np.isfinite(coarse.initial_table).any() else np.nan
    if not level >= AGREES:
        # Too few pairs share points to agree or to disagree.
        return ()
    names = examination.observations.rig.names
    if len(names) == 2:
        sentence = (
            f"Cameras {names[0]!r} and {names[1]!r} do not agree; two cameras are not enough to tell which one is "
            "wrong."
        )
    else:
        sentence = (
            "Hardly any two cameras agree, and no other camera order, image rotation or image size makes them agree."
        )
    remedy = (
        "The calibration probably belongs to another camera setup or another day. Use the matching calibration, or "
        "calibrate again."
    )
    certainty = float(np.clip(level, 0.5, 0.97))
    kind = FindingKind.WRONG_CALIBRATION
    return (Finding(kind, (), None, level, "disagreement", np.nan, certainty, 2000.0, sentence, remedy),)
