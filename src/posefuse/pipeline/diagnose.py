"""Diagnose a recording: the recording check, and the time offsets of views."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from posefuse.arguments import checked
from posefuse.diagnostics import recording_check
from posefuse.diagnostics.examine import DEEP, SHORT, examine
from posefuse.diagnostics.findings import rank_findings
from posefuse.diagnostics.observations import TrackedObservations
from posefuse.diagnostics.recording_check import collect_observations
from posefuse.diagnostics.registry import list_findings
from posefuse.diagnostics.time_offsets import ViewTiming
from posefuse.errors import DetectionsError
from posefuse.io.open_recording import RecordingInputs, open_recording
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.findings import Finding
from posefuse.model.options.options import Options
from posefuse.model.options.sync import SyncOptions
from posefuse.model.subjects import Subjects
from posefuse.parallel import ONE_JOB, JobCount, Jobs, number_of_jobs
from posefuse.pipeline.defaults import RecordingFacts, cut_time, resolve_people
from posefuse.pipeline.people.find_subjects import find_subjects
from posefuse.pipeline.people.stills import STILLS
from posefuse.pipeline.plan import Plan, useful_jobs
from posefuse.preprocess.match_cameras import match_views
from posefuse.preprocess.time_offsets import shift_views
from posefuse.progress import Progress, Silent


def check_recording(plan: Plan) -> Plan:
    """Return the plan with the findings of a short recording check in addition to its own; see :func:`begin_check`."""
    return replace(plan, findings=begin_check(plan)())


def begin_check(plan: Plan, jobs: Jobs = ONE_JOB) -> Callable[[], tuple[Finding, ...]]:
    """Begin a short recording check, and return the function that waits for the findings of the plan and the check.

    One camera and unrelated frames cannot be checked, and ``health = "off"`` disables the check.

    Args:
        plan: plan of the reconstruction.
        jobs: processes, of which one checks.
    """
    if len(plan.rig) == 1 or plan.options.health == "off" or plan.options.people == STILLS:
        return lambda: plan.findings
    collect = partial(recording_check.collect_observations, plan.rig, plan.detections, plan.subjects)
    check = jobs.begin_made(_find_faults, collect)

    def wait() -> tuple[Finding, ...]:
        known = {finding.kind for finding in plan.findings}
        return rank_findings([*plan.findings, *(finding for finding in check() if finding.kind not in known)])

    return wait


def _find_faults(observations: TrackedObservations) -> tuple[Finding, ...]:
    return list_findings(examine(observations, SHORT))


@checked
def inspect_health(
    rig: CameraRig | str | Path,
    detections: Detections | None = None,
    options: Options | None = None,
    *,
    inputs: RecordingInputs | None = None,
    progress: Progress | None = None,
    jobs: JobCount = 1,
) -> tuple[Finding, ...]:
    """Find the problems of a recording from its own detections; the page "Diagnostics" explains them.

    Args:
        rig: calibrated cameras, or the folder of a recording.
        detections: 2D keypoints, unless a folder is given.
        options: options as of :func:`reconstruct`; those that assign detections to people are used, and ``sync``.
        inputs: paths of inputs that are not found in the folder or are ambiguous there.
        progress: receives the progress.
        jobs: number of processes; "auto" uses the physical cores if the recording is long enough.

    Returns:
        Findings, the most serious first.

    Raises:
        MatchError: if views and cameras do not match.
        DetectionsError: if the detections do not allow what the options ask for.
    """
    options, progress = options or Options(), progress or Silent()
    if not isinstance(rig, CameraRig):
        opened = open_recording(Path(rig), inputs, options, progress)
        rig, detections = opened.rig, opened.detections
    elif detections is None:
        raise DetectionsError("inspect_health needs detections in addition to the rig, or the folder of a recording.")
    with Jobs(number_of_jobs(jobs, useful_jobs(detections))) as workers:
        checked_views = _with_subjects(rig, detections, options, progress, workers)
        return recording_check.find_faults(*checked_views, DEEP, workers)


@checked
def measure_sync(
    rig: CameraRig,
    detections: Detections,
    options: Options | None = None,
    *,
    reference: str | None = None,
    reach_s: float = DEEP.max_offset_s,
    progress: Progress | None = None,
) -> tuple[tuple[ViewTiming, ...], SyncOptions]:
    """Measure the time offset of each view from the detections.

    Args:
        rig: calibrated cameras.
        detections: 2D keypoints.
        options: options as of :func:`reconstruct`; those that assign detections to people are used, and ``sync``:
            offsets are those that remain after its correction.
        reference: camera whose clock is correct; by default that of most views.
        reach_s: largest time offset to search, in seconds.
        progress: receives the progress.

    Returns:
        The timing of each view, and the options with which :func:`reconstruct` corrects it; they do not include
        ``options.sync``.

    Raises:
        MatchError: if views and cameras do not match, or the reference does not exist.
        DetectionsError: if the views agree too little to measure offsets, or frame times are unknown.
    """
    timings, sync, _ = judge_sync(rig, detections, options, reference=reference, reach_s=reach_s, progress=progress)
    return timings, sync


def judge_sync(
    rig: CameraRig,
    detections: Detections,
    options: Options | None = None,
    *,
    reference: str | None = None,
    reach_s: float = DEEP.max_offset_s,
    progress: Progress | None = None,
) -> tuple[tuple[ViewTiming, ...], SyncOptions, tuple[Finding, ...]]:
    """Return the results of :func:`measure_sync`, and the findings of :func:`inspect_health`; arguments as there."""
    subjects = _with_subjects(rig, detections, options or Options(), progress or Silent())
    if len(subjects[0]) < 2:
        raise DetectionsError(
            "sync measures the time offsets between views; it needs two cameras or more, and one is used."
        )
    effort = replace(DEEP, max_offset_s=reach_s)
    examination, timings = recording_check.measure_timing(*subjects, effort, reference)
    if timings is None:
        raise DetectionsError(
            "The views do not agree well enough to measure their time offsets. Find the cause with "
            "`posefuse.inspect_health`."
        )
    if not examination.observations.rate_known:
        raise DetectionsError("sync needs times, but the files contain no frame rate. Add `rate_hz`.")
    return timings, recording_check.sync_options(timings), list_findings(examination)


PoseSds = dict[str, tuple[float, float]]
"""Name of a camera -> standard deviations of its pose in degrees and m."""


def begin_judging(
    rig: CameraRig, detections: Detections, options: Options, jobs: Jobs = ONE_JOB
) -> Callable[[], tuple[tuple[Finding, ...], PoseSds]]:
    """Begin to judge poses, and return the function that waits for the result.

    The result are the findings of :func:`inspect_health`, and the standard deviations of the poses, which are empty if
    the views do not agree well enough.

    Args:
        rig: calibrated cameras.
        detections: 2D keypoints.
        options: options as of :func:`inspect_health`.
        jobs: processes, of which one judges.
    """
    return jobs.begin(_judge_poses, (rig, detections, options))


def _judge_poses(given: tuple[CameraRig, Detections, Options]) -> tuple[tuple[Finding, ...], PoseSds]:
    rig, detections, options = given
    examination = examine(collect_observations(*_with_subjects(rig, detections, options, Silent())))
    sds = {} if examination.verdict is None else examination.verdict.pose_sds()
    return list_findings(examination), sds


def _with_subjects(
    rig: CameraRig, detections: Detections, options: Options, progress: Progress, jobs: Jobs = ONE_JOB
) -> tuple[CameraRig, Detections, Subjects]:
    """Return the matched cameras and views, and the assignment of detections to people."""
    if options.rate_hz is not None and detections.rate_hz is None:
        detections = detections.with_rate(options.rate_hz)
    rig, detections, _ = match_views(rig, detections, options)
    detections = cut_time(detections, options)
    if detections.n_frames == 0:
        raise DetectionsError("The recording is empty: it has no frames.")
    if not options.sync.does_nothing:
        detections = shift_views(detections, rig.names, options.sync).detections
    options = resolve_people(replace(options, bodies="none"), RecordingFacts.of(detections), len(rig))
    if options.people == STILLS:
        raise DetectionsError(
            "The recording check and the measurement of time offsets compare consecutive frames, but these are "
            "unrelated (`people='stills'`, which \"auto\" selects for frames more than 2 s apart). `people='many'` "
            "tracks people nevertheless."
        )
    return rig, detections, find_subjects(rig, detections, options, progress, jobs=jobs)[0]
