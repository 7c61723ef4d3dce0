"""Find views that share too few observations with the others."""

import numpy as np

from posefuse.diagnostics.examination import Examination
from posefuse.model.findings import Finding, FindingKind

_MIN_SHARED, _MIN_SHARED_OVERALL = 0.15, 0.3
_MIN_OBSERVATIONS = 200


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return findings for views with low overlap, or one finding if the whole recording has low overlap."""
    seen = np.isfinite(examination.detected.pixels[..., 0])
    views_per_point = seen.sum(axis=1)
    observed = int((views_per_point > 0).sum())
    if seen.shape[1] < 2 or observed < _MIN_OBSERVATIONS:
        return ()
    share = float((views_per_point >= 2).sum() / observed)
    names = examination.observations.rig.names
    if share < _MIN_SHARED_OVERALL:
        sentence = (
            f"Only {100 * share:.0f} % of the keypoints are detected by two or more cameras; the others cannot be "
            "triangulated."
        )
        remedy = "Point the cameras at the same volume, or check that the keypoints of all cameras were found."
        return (_finding((), share, sentence, remedy),)
    out = []
    for v, name in enumerate(names):
        count = int(seen[:, v].sum())
        shared = float((seen[:, v] & (views_per_point >= 2)).sum() / max(count, 1))
        if count == 0:
            remedy = f"Exclude the camera: `exclude_camera={[name]!r}`"
            out.append(_finding((name,), 0.0, f"View {name!r} has no detections.", remedy))
        elif shared < _MIN_SHARED and count >= _MIN_OBSERVATIONS:
            sentence = f"Only {100 * shared:.0f} % of the keypoints in view {name!r} are detected by another camera."
            out.append(_finding((name,), shared, sentence, "Point it at the volume that the other cameras see."))
    return tuple(out)


def _finding(cameras: tuple[str, ...], size: float, sentence: str, remedy: str) -> Finding:
    return Finding(FindingKind.LOW_OVERLAP, cameras, None, size, "share", np.nan, 0.99, 50.0, sentence, remedy)
