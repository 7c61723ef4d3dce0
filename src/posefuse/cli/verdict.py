"""The verdict on poses and clocks, in the same words for inspect, sync and refine-calibration."""

from collections.abc import Sequence

from posefuse.cli.console import say
from posefuse.model.findings import CLOCK_FINDINGS, POSE_FINDINGS, Finding


def say_verdict(findings: Sequence[Finding]) -> None:
    """Print which poses and clocks are wrong, or that none is."""
    about = [finding for finding in findings if finding.kind in (*POSE_FINDINGS, *CLOCK_FINDINGS)]
    if not about:
        say("verdict: the recording shows no wrong camera pose and no wrong clock")
    for finding in about:
        say(f"verdict: {finding.kind}: {finding.sentence}")
