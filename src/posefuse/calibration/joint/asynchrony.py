"""Decide whether the cameras of a recording have no common trigger.

Each clock of free-running cameras is off by some share of a frame, so that no single one stands out. The evidence of
offsets of all views of this size is compared with that of offsets as small as a trigger leaves them.
"""

import numpy as np

from posefuse.calibration.joint.estimate import JointEstimate
from posefuse.calibration.joint.evidence import Comparison, Explanation

TRIGGERED_S = (1e-3,)
"""Standard deviation of the offsets of cameras with a common trigger."""
FREE_RUNNING_FRAMES = (12.0**-0.5, 1.0)
"""Standard deviations of the offsets of free-running cameras: of frames that are matched with the nearest ones of the
other cameras, and of frames that are delivered some frames later."""
PROBABILITY = 0.1
"""Share of all recordings with free-running cameras and timestamps that do not show it, assumed before any data."""


def log_odds_of_free_running(estimate: JointEstimate, explanations: tuple[Explanation, ...], period_s: float) -> float:
    """Return the logarithm of the odds that the clocks of all views differ as those of free-running cameras do.

    Args:
        estimate: of all views.
        explanations: accepted ones; a view that stands out does not show that the others are free-running, too.
        period_s: time between frames.
    """
    free, triggered = (
        float(Comparison(estimate, levels_s).log_evidence_of_each(explanations, (None,))[0])
        for levels_s in (tuple(share * period_s for share in FREE_RUNNING_FRAMES), TRIGGERED_S)
    )
    return free - triggered + float(np.log(PROBABILITY / (1.0 - PROBABILITY)))
