"""The health check of a recording whose people are known: what is looked at, and what is said."""

import numpy as np

from posefuse.diagnostics.examine import Effort, Examination, examine, findings_of
from posefuse.diagnostics.findings import Finding
from posefuse.diagnostics.observations import Evidence, gather
from posefuse.diagnostics.time_offsets import ViewTiming, time_views
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.sync import SyncOptions
from posefuse.model.subjects import Subjects
from posefuse.model.tracks import Tracks

_MOST_S, _PIECES = 180.0, 9
_CERTAIN = 3.0
_DOUBT = 2.0


def evidence_of(rig: CameraRig, detections: Detections, subjects: Subjects) -> Evidence:
    """What there is to look at: all of a recording, or evenly spread pieces of a long one."""
    spans = _spans(detections)
    starts = np.cumsum([0, *(stop - start for start, stop in spans[:-1])])
    tracks = Tracks.concatenate([subjects.tracks(*span) for span in spans])
    return gather(rig, detections.pieces(spans), tracks, tuple(starts.tolist()))


def check(rig: CameraRig, detections: Detections, subjects: Subjects, effort: Effort) -> tuple[Finding, ...]:
    """What is wrong with a recording, the worst first.

    Args:
        rig: a camera a view.
        detections: the 2D keypoints.
        subjects: whose detection is whose.
        effort: how closely to look.
    """
    return findings_of(examine(evidence_of(rig, detections, subjects), effort))


def timing(
    rig: CameraRig, detections: Detections, subjects: Subjects, effort: Effort, reference: str | None
) -> tuple[Examination, tuple[ViewTiming, ...] | None]:
    """How late views are.

    Args:
        rig: a camera a view.
        detections: the 2D keypoints.
        subjects: whose detection is whose.
        effort: how closely to look.
        reference: the camera whose clock is right; by default that of most views.
    """
    examination = examine(evidence_of(rig, detections, subjects), effort, doubt=_DOUBT)
    return examination, time_views(examination, None if reference is None else rig.index(reference))


def sync_of(timings: tuple[ViewTiming, ...]) -> SyncOptions:
    """What puts views in step; those that are so already, as far as is known, are left out."""
    rows = [
        (view.camera, *row)
        for view in timings
        if _out_of_step(view)
        for row in zip(view.since_s, view.late_s, view.drift_ppm, strict=True)
    ]
    columns = tuple(zip(*rows, strict=True)) if rows else ((), (), (), ())
    return SyncOptions(*columns)


def _out_of_step(view: ViewTiming) -> bool:
    moved = max(abs(late) for late in view.late_s) > _CERTAIN * view.late_sd_s
    return moved or len(view.late_s) > 1 or any(view.drift_ppm)


def _spans(detections: Detections) -> list[tuple[int, int]]:
    rate = detections.rate_hz or 25.0
    most = int(_MOST_S * rate)
    if detections.n_frames <= most:
        return [(0, detections.n_frames)]
    length = most // _PIECES
    starts = np.linspace(0, detections.n_frames - length, _PIECES).astype(int)
    return [(int(start), int(start) + length) for start in starts]
