"""Everything a health check looks for: add a finder here."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from posefuse.diagnostics import (
    camera_order,
    camera_poses,
    clocks,
    confidence,
    copied_poses,
    image_orientation,
    left_right_swaps,
    lenses,
    repeated_frames,
    view_overlap,
    wrong_rig,
)
from posefuse.diagnostics.findings import Finding

if TYPE_CHECKING:
    from posefuse.diagnostics.examine import Examination

FINDERS: tuple[Callable[["Examination"], tuple[Finding, ...]], ...] = (
    wrong_rig.find,
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
)
