"""Rank the findings of the recording check and estimate their certainty."""

import math

import numpy as np

from posefuse.model.findings import Finding


def rank_findings(findings: list[Finding]) -> tuple[Finding, ...]:
    """Return findings in order of decreasing gain."""
    return tuple(sorted(findings, key=lambda f: (-f.gain, f.kind, f.cameras)))


def certainty_of(score: float, competitors: list[float]) -> float:
    """Return the certainty of a hypothesis from its penalized gain and those of its competitors."""
    present = 1.0 / (1.0 + math.exp(-0.5 * min(max(score - 10.0, -60.0), 60.0)))
    preferred = 1.0 / (1.0 + sum(math.exp(min(0.5 * (competitor - score), 0.0)) for competitor in competitors))
    return float(np.clip(present * preferred, 0.0, 0.99))
