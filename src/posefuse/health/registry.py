"""Everything a health check looks for: add a finder here."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from posefuse.health import clocks, confidences, copies, foreign, images, lenses, order, overlap, poses, repeats, sides
from posefuse.health.findings import Finding

if TYPE_CHECKING:
    from posefuse.health.examine import Examination

FINDERS: tuple[Callable[["Examination"], tuple[Finding, ...]], ...] = (
    foreign.find,
    order.find,
    copies.find,
    images.find,
    poses.find,
    lenses.find,
    clocks.find,
    repeats.find,
    sides.find,
    confidences.find,
    overlap.find,
)
