"""What a health check finds, as records."""

import math

import numpy as np

from posefuse.model.findings import Finding, Kind

HEALTH = "Health: "
"""What a note of a result begins with that is a finding."""


__all__ = ["HEALTH", "Finding", "Kind", "certainty_of", "ranked"]


def ranked(findings: list[Finding]) -> tuple[Finding, ...]:
    """Those that spoil most first."""
    return tuple(sorted(findings, key=lambda f: (-f.gain, f.kind, f.cameras)))


def certainty_of(score: float, rivals: list[float]) -> float:
    """How certain a hypothesis is whose penalised gain is ``score``, beside those of others as good."""
    wrong = 1.0 / (1.0 + math.exp(-0.5 * min(max(score - 10.0, -60.0), 60.0)))
    share = 1.0 / (1.0 + sum(math.exp(min(0.5 * (rival - score), 0.0)) for rival in rivals))
    return float(np.clip(wrong * share, 0.0, 0.99))
