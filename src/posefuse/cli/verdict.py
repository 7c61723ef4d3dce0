"""The verdict on poses and clocks, in the same words for inspect, sync, refine-calibration and the report."""

from collections.abc import Sequence

from posefuse.cli.console import say
from posefuse.model.findings import Finding, verdict_sentences


def say_verdict(findings: Sequence[Finding]) -> None:
    """Print which poses and clocks are wrong, or that none is."""
    for sentence in verdict_sentences(findings):
        say(f"verdict: {sentence}")
