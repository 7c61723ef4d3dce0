"""State what a bounded check did not examine."""

import numpy as np

from posefuse.diagnostics.examination import Examination
from posefuse.model.findings import Finding, FindingKind


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return a finding if the search for faults reached its bound, else nothing."""
    skipped = [] if examination.coarse is None else list(examination.coarse.skipped)
    if examination.fine is not None and not examination.fine.complete:
        skipped.append("further small faults of single views")
    if not skipped:
        return ()
    sentence = f"The check did not examine {', '.join(skipped)}: that would take too long."
    remedy = "Correct the other findings and check again; `posefuse.inspect_health` has a higher bound."
    return (Finding(FindingKind.INCOMPLETE, (), None, np.nan, "", np.nan, 1.0, 0.0, sentence, remedy),)
