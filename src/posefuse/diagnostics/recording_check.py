"""Check a recording whose people are tracked: collect observations, examine them, list findings, measure clocks."""

import numpy as np

from posefuse.diagnostics.examination import Examination
from posefuse.diagnostics.examine import Effort, examine
from posefuse.diagnostics.observations import TrackedObservations, gather_observations
from posefuse.diagnostics.registry import list_findings
from posefuse.diagnostics.time_offsets import ViewTiming, time_views
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.findings import Finding
from posefuse.model.options.sync import SyncOptions
from posefuse.model.subjects import Subjects
from posefuse.model.tracks import Tracks
from posefuse.parallel import ONE_JOB, Jobs

_MAX_EXAMINED_S, _PIECES = 180.0, 9


def collect_observations(rig: CameraRig, detections: Detections, subjects: Subjects) -> TrackedObservations:
    """Return the observations of a whole recording, or of evenly spaced pieces of a long one."""
    spans = _spans(detections)
    tracks = Tracks.concatenate([subjects.tracks(*span) for span in spans])
    return gather_observations(rig, detections, tracks, spans)


def find_faults(
    rig: CameraRig, detections: Detections, subjects: Subjects, effort: Effort, jobs: Jobs = ONE_JOB
) -> tuple[Finding, ...]:
    """Return the faults of a recording, the most harmful first.

    Args:
        rig: one camera per view.
        detections: 2D keypoints.
        subjects: assignment of detections to people.
        effort: how closely to look.
        jobs: processes that test the corrections of suspect views.
    """
    return list_findings(examine(collect_observations(rig, detections, subjects), effort, jobs=jobs))


def measure_timing(
    rig: CameraRig, detections: Detections, subjects: Subjects, effort: Effort, reference: str | None
) -> tuple[Examination, tuple[ViewTiming, ...] | None]:
    """Measure the time offset and clock drift of every view.

    Args:
        rig: one camera per view.
        detections: 2D keypoints.
        subjects: assignment of detections to people.
        effort: how closely to look.
        reference: name of the camera with the reference clock; by default the clock that most views share.

    Returns:
        The examination, and the timing of each view or None if the views do not agree well enough.
    """
    examination = examine(collect_observations(rig, detections, subjects), effort)
    return examination, time_views(examination, None if reference is None else rig.index(reference))


def sync_options(timings: tuple[ViewTiming, ...]) -> SyncOptions:
    """Return options that correct the views whose clocks are wrong; other views are left out."""
    rows = [
        (view.camera, *row)
        for view in timings
        if view.is_corrected
        for row in zip(view.start_s, view.offset_s, view.drift_ppm, strict=True)
    ]
    columns = tuple(zip(*rows, strict=True)) if rows else ((), (), (), ())
    return SyncOptions(*columns)


def _spans(detections: Detections) -> list[tuple[int, int]]:
    """Return the frame ranges to examine: the whole recording, or evenly spaced pieces of a long one."""
    rate = detections.rate_hz or 25.0
    max_frames = int(_MAX_EXAMINED_S * rate)
    if detections.n_frames <= max_frames:
        return [(0, detections.n_frames)]
    length = max_frames // _PIECES
    starts = np.linspace(0, detections.n_frames - length, _PIECES).astype(int)
    return [(int(start), int(start) + length) for start in starts]
