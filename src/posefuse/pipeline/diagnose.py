"""What is wrong with a recording, and how late its views are: the recipe of ``inspect --deep`` and ``sync``."""

from dataclasses import replace

from posefuse.diagnostics import recording_check
from posefuse.diagnostics.examine import DEEP, SHORT
from posefuse.diagnostics.findings import NOTE_PREFIX
from posefuse.diagnostics.time_offsets import ViewTiming
from posefuse.errors import DetectionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.findings import Finding
from posefuse.model.options.options import Options
from posefuse.model.options.sync import SyncOptions
from posefuse.model.subjects import Subjects
from posefuse.pipeline.defaults import cut_time, settle_people
from posefuse.pipeline.measured_layer import Plan
from posefuse.pipeline.reconstruct import who_is_followed
from posefuse.preprocess.match_cameras import match_views
from posefuse.progress import Progress, Silent


def with_health(plan: Plan) -> Plan:
    """The plan with what a short look says is wrong with the recording, in its notes."""
    if len(plan.rig) == 1:
        return plan
    found = recording_check.find_faults(plan.rig, plan.detections, plan.subjects, SHORT)
    said = tuple(f"{NOTE_PREFIX}{finding}" for finding in found)
    return replace(plan, provenance=plan.provenance.with_notes(said))


def inspect_health(
    rig: CameraRig, detections: Detections, options: Options | None = None, *, progress: Progress | None = None
) -> tuple[Finding, ...]:
    """What is wrong with a recording, by its own detections, the worst first; see docs/health.md.

    Args:
        rig: calibrated cameras.
        detections: 2D keypoints.
        options: as of :func:`reconstruct`; those that say who is who count.
        progress: told how far the work is.

    Raises:
        MatchError: if views and cameras do not belong together.
        DetectionsError: if the detections do not allow what the options ask for.
    """
    return recording_check.find_faults(*_followed(rig, detections, options or Options(), progress or Silent()), DEEP)


def measure_sync(
    rig: CameraRig,
    detections: Detections,
    options: Options | None = None,
    *,
    reference: str | None = None,
    reach_s: float = DEEP.max_offset_s,
    progress: Progress | None = None,
) -> tuple[tuple[ViewTiming, ...], SyncOptions]:
    """How late each view is, by its own detections, and what makes :func:`reconstruct` put views in step.

    Args:
        rig: calibrated cameras.
        detections: 2D keypoints.
        options: as of :func:`reconstruct`; those that say who is who count.
        reference: the camera whose clock is right; by default that of most views.
        reach_s: how late views may be.
        progress: told how far the work is.

    Raises:
        MatchError: if views and cameras do not belong together, or there is no such reference.
        DetectionsError: if the views agree too little to tell, or files say no frame rate.
    """
    followed = _followed(rig, detections, options or Options(), progress or Silent())
    effort = replace(DEEP, max_offset_s=reach_s)
    examination, timings = recording_check.measure_timing(*followed, effort, reference)
    if timings is None:
        raise DetectionsError(
            "The views agree too little to tell how late they are. posefuse inspect RECORDING --deep says what is "
            "wrong with them."
        )
    if not examination.observations.rate_known:
        raise DetectionsError("sync needs times, and the files give no frame rate. Add --rate-hz.")
    return timings, recording_check.sync_options(timings)


def _followed(
    rig: CameraRig, detections: Detections, options: Options, progress: Progress
) -> tuple[CameraRig, Detections, Subjects]:
    """The matched cameras and views, and whose detections are whose."""
    if options.rate_hz is not None and detections.rate_hz is None:
        detections = detections.with_rate(options.rate_hz)
    rig, detections, _ = match_views(rig, detections, options)
    detections = cut_time(detections, options)
    if detections.n_frames == 0:
        raise DetectionsError("The recording is empty: it has no frames.")
    options = settle_people(replace(options, bodies="none"), detections, len(rig))
    return rig, detections, who_is_followed(rig, detections, options, progress)[0]
