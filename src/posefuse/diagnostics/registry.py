"""Table of all finders of faults; add a finder here."""

from collections.abc import Callable

from posefuse.diagnostics import (
    camera_order,
    camera_poses,
    clocks,
    confidence,
    copied_poses,
    image_orientation,
    incomplete,
    left_right_swaps,
    lenses,
    repeated_frames,
    view_overlap,
    world_scale,
    wrong_calibration,
)
from posefuse.diagnostics.examination import Examination
from posefuse.diagnostics.findings import rank_findings
from posefuse.model.findings import Finding

FINDERS: tuple[Callable[[Examination], tuple[Finding, ...]], ...] = (
    wrong_calibration.find,
    world_scale.find,
    camera_order.find,
    copied_poses.find,
    image_orientation.find,
    camera_poses.find,
    lenses.find,
    clocks.find,
    repeated_frames.find,
    left_right_swaps.find,
    confidence.find,
    view_overlap.find,
    incomplete.find,
)


def list_findings(examination: Examination) -> tuple[Finding, ...]:
    """Return all faults of an examined recording, the most harmful first."""
    return rank_findings([finding for find in FINDERS for finding in find(examination)])
