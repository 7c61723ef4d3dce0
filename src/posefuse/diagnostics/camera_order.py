"""Find views that use each other's calibrations."""

import numpy as np

from posefuse.diagnostics.examination import Examination
from posefuse.model.findings import Finding, FindingKind


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return a finding if views fit the calibrations of other cameras."""
    coarse = examination.coarse
    if coarse is None or not coarse.views_agree:
        return ()
    scores = [correction.score for correction in coarse.corrections if correction.kind == "order"]
    names = examination.observations.rig.names
    moved = [v for v, camera in enumerate(coarse.model.cameras) if camera != v]
    if not scores or not moved:
        return ()
    pairs = ", ".join(f"view {names[v]!r} is from camera {names[coarse.model.cameras[v]]!r}" for v in moved)
    order = [names[camera] for camera in coarse.model.cameras]
    sentence = f"The views are assigned to the wrong cameras: {pairs}."
    remedy = f"Rename the cameras, or set the order: `camera_order={order!r}`"
    cameras = tuple(names[v] for v in moved)
    size, gain = float(len(moved)), 0.5 * len(moved) * sum(scores)
    return (Finding(FindingKind.CAMERA_ORDER, cameras, None, size, "views", np.nan, 0.97, gain, sentence, remedy),)
