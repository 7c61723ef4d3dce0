"""Record of one examination of a recording, which the finders of faults read."""

from dataclasses import dataclass

import numpy as np

from posefuse.diagnostics.coarse_search import CoarseResult
from posefuse.diagnostics.fine_result import FineResult
from posefuse.diagnostics.observations import TrackedObservations
from posefuse.diagnostics.sample_points import SamplePoints
from posefuse.diagnostics.verdict import Verdict


@dataclass(frozen=True, eq=False)
class Examination:
    """Hold the results of all searches for faults of one recording.

    Attributes:
        observations: tracked observations, with left/right labels corrected in views that often swap them.
        detected: the same observations as detected.
        coarse: gross faults, or None if there are too few observations.
        fine: small faults, or None if the views do not agree well enough.
        swap_shares: shape (view,): share of the time in which each view swaps left and right.
        points: triangulated samples with all faults corrected, or None.
        verdict: joint estimate of poses and clocks and what is wrong with them, or None.
    """

    observations: TrackedObservations
    detected: TrackedObservations
    coarse: CoarseResult | None
    fine: FineResult | None
    swap_shares: np.ndarray
    points: SamplePoints | None
    verdict: Verdict | None = None
