"""``posefuse inspect``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from posefuse.cli.console import Bars, count, note, percent, say, table, warn
from posefuse.cli.findings import AcceptFindings, exit_on_certain_faults
from posefuse.cli.types import (
    CalibrationPath,
    KeypointsPath,
    OptionFlags,
    Recording,
    SyncPath,
    TimestampsPath,
    with_sync,
)
from posefuse.errors import PosefuseError, RecordingError, choices
from posefuse.io.open_recording import keypoint_request
from posefuse.io.recording import RecognizedInput, find_recording, ignored_in
from posefuse.io.videos_only import videos_only
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.findings import Finding
from posefuse.model.options.options import Options

_MOST_CAMERAS = 24
_MOST_NAMES = 4


@dataclass(frozen=True)
class _Inputs:
    """Calibrations and keypoints that could be read, with their paths."""

    rigs: list[tuple[Path, CameraRig]]
    detections: list[tuple[Path, Detections]]


def inspect(
    recording: Recording,
    *,
    calibration: CalibrationPath = None,
    keypoints: KeypointsPath = None,
    timestamps: TimestampsPath = None,
    sync: SyncPath = None,
    deep: Annotated[bool, Parameter(negative="", help="Check the recording for faults by its detections.")] = False,
    accept_findings: AcceptFindings = False,
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Show the calibrations and keypoints in a folder, how they were recognized, and whether they match.

    With --deep, also check the recording for faults: moved cameras, time offsets, rotated images, and more. The exit
    code is then 3 if a fault is certain that makes results wrong; --accept-findings makes it 0.
    """
    options = with_sync(options, sync)
    found = find_recording(recording)
    calibrations = found.calibrations if calibration is None else (_given(calibration, calibration=True),)
    keypoint_sets = found.keypoints if keypoints is None else (_given(keypoints, calibration=False),)
    if not keypoint_sets and not calibrations and (advice := videos_only(recording)) is not None:
        raise RecordingError(advice)
    if not calibrations and not keypoint_sets:
        raise RecordingError(
            f"{recording} contains no calibration and no 2D keypoints in a known format. posefuse formats lists the "
            "known formats."
        )
    rigs = [(item.path, rig) for item in calibrations if (rig := _calibration(item, options)) is not None]
    seen = [
        (item.path, one)
        for item in keypoint_sets
        if (one := _keypoints(item, recording, timestamps, options)) is not None
    ]
    if not keypoint_sets:
        note(videos_only(recording) or "no 2D keypoints")
    if not calibrations:
        say("no calibration")
        if len(seen) == 1 and seen[0][1].n_views == 1 and options.needs_no_poses:
            say("1 view needs no calibration; posefuse reconstruct gives its points in px")
    ignored = ignored_in(found)
    if ignored:
        say("not read:")
    for item in ignored:
        note(f"  {choices(item.names, _MOST_NAMES)}: {item.reason}")
    matched = _say_matches(_Inputs(rigs, seen), options)
    if deep and len(rigs) == len(seen) == 1:
        if matched:
            findings = _examine(rigs[0][1], seen[0][1], options)
            exit_on_certain_faults(findings, accept_findings, "results are")
    elif deep:
        raise RecordingError(
            "--deep needs one calibration and one set of keypoints. Add --calibration FILE and --keypoints PATH."
        )


def _given(path: Path, *, calibration: bool) -> RecognizedInput:
    """Return the path that the user gives, with its format."""
    from posefuse.io.calibration.read import find_format as calibration_format
    from posefuse.io.keypoints.read import find_format as keypoint_format

    form = (calibration_format if calibration else keypoint_format)(path)
    return RecognizedInput(path, "unknown") if form is None else RecognizedInput(path, form.name, form.recognized_by)


def _examine(rig: CameraRig, detections: Detections, options: Options) -> tuple[Finding, ...]:
    """Print and return the findings of the recording check, the most severe first."""
    from posefuse.cli.verdict import say_verdict
    from posefuse.pipeline.diagnose import inspect_health

    if detections.n_views < 2:
        say("recording check: nothing checked, because the views of one camera cannot contradict each other")
        return ()
    found = inspect_health(rig, detections, options, progress=Bars())
    if not found:
        say("recording check: no faults found")
        say_verdict(found)
        return found
    say(f"recording check: {count(len(found), 'finding')}, the most severe first")
    for number, finding in enumerate(found, 1):
        say(f"{number}. {finding.kind}: {finding.sentence}")
        say(f"   {100 * finding.certainty:.0f} % certain. {finding.remedy}")
    say_verdict(found)
    return found


def _calibration(item: RecognizedInput, options: Options) -> CameraRig | None:
    from posefuse.io.calibration.read import read_cameras

    say(f"calibration {item.path} ({item.format})")
    if item.recognized_by:
        note(f"  recognized by: {item.recognized_by}")
    try:
        rig = read_cameras(item.path, length_unit=options.length_unit, up=options.up)
    except PosefuseError as error:
        note(f"  cannot be read: {error}")
        return None
    say(f"  {len(rig)} cameras; up axis {rig.up_text}, lengths x {rig.meters_per_unit:g} to meters")
    for remark in rig.notes:
        note(f"  note: {remark}")
    rows = []
    for camera in rig.cameras[:_MOST_CAMERAS]:
        size = f"{camera.size_px[0]} x {camera.size_px[1]}"
        at = " ".join(f"{value:.2f}" for value in camera.center_m)
        rows.append([f"  {camera.name}", size, f"{camera.matrix[0, 0]:.0f}", str(camera.lens), at])
    table(None, ["  camera", "size px", "focal px", "lens", "position m"], rows)
    if len(rig) > _MOST_CAMERAS:
        say(f"  and {len(rig) - _MOST_CAMERAS} more, up to {rig.names[-1]}")
    return rig


def _keypoints(item: RecognizedInput, recording: Path, timestamps: Path | None, options: Options) -> Detections | None:
    from posefuse.io.keypoints.read import read_keypoints

    say(f"keypoints {item.path} ({item.format})")
    if item.recognized_by:
        note(f"  recognized by: {item.recognized_by}")
    try:
        request = keypoint_request(recording, item.path, options, Bars(), timestamps)
        detections = read_keypoints(item.path, request)
    except PosefuseError as error:
        note(f"  cannot be read: {error}")
        return None
    rate = "unknown (--rate-hz)" if detections.rate_hz is None else f"{detections.rate_hz:g} Hz"
    first, last = detections.frame_numbers[[0, -1]]
    say(f"  skeleton {detections.skeleton.name}, {len(detections.skeleton)} keypoints; rate {rate}")
    say(f"  frames {first} to {last}{_span(detections)}")
    for remark in detections.notes:
        note(f"  note: {remark}")
    _views_table(detections)
    return detections


def _span(detections: Detections) -> str:
    """Return the time span as text, empty if times are unknown."""
    times = detections.time_s[np.isfinite(detections.time_s)]
    return f", {times.min():.3f} to {times.max():.3f} s" if len(times) else ""


def _views_table(detections: Detections) -> None:
    counts = detections.people_counts
    missing = _missing_shares(detections)
    rows = []
    for v, name in enumerate(detections.view_names[:_MOST_CAMERAS]):
        recorded = detections.recorded[:, v]
        people = counts[recorded, v] if recorded.any() else np.zeros(1, dtype=np.int64)
        rate = _rate_hz(detections, v)
        rows.append(
            [
                f"  {name}",
                str(int(recorded.sum())),
                str(int((~recorded).sum())),
                "-" if rate is None else f"{rate:.4g}",
                f"{people.min()} to {people.max()}",
                percent(missing[v]),
            ]
        )
    table(None, ["  view", "frames", "missing", "Hz", "people", "keypoints missing"], rows)
    if detections.n_views > _MOST_CAMERAS:
        say(f"  and {detections.n_views - _MOST_CAMERAS} more, up to {detections.view_names[-1]}")


def _rate_hz(detections: Detections, view: int) -> float | None:
    """Return the frame rate of a view from its timestamps, or None without timestamps."""
    times = detections.time_s[:, view]
    known = np.flatnonzero(np.isfinite(times))
    if len(known) < 2:
        return None
    numbers = detections.frame_numbers[known]
    step_s = float(np.median(np.diff(times[known]) / np.diff(numbers)))
    return 1.0 / step_s if step_s > 0 else None


def _missing_shares(detections: Detections) -> np.ndarray:
    """Return the fraction of undetected keypoints of the detected people, shape (view,)."""
    missing = np.zeros(detections.n_views)
    total = np.zeros(detections.n_views)
    for chunk in detections.chunks():
        views = np.repeat(np.tile(np.arange(chunk.n_views), chunk.n_frames), np.diff(chunk.offsets))
        absent = np.isnan(np.asarray(chunk.keypoints_px)).any(axis=-1)
        missing += np.bincount(views, absent.sum(axis=1), minlength=chunk.n_views)
        total += np.bincount(views, minlength=chunk.n_views) * len(chunk.skeleton)
    return missing / np.maximum(total, 1)


def _say_matches(read: _Inputs, options: Options) -> bool:
    """Print which keypoints and calibrations match, and the flags that choose them; return whether any match."""
    from posefuse.preprocess.match_cameras import match_views

    single = len(read.rigs) == 1 and len(read.detections) == 1
    said, refused = [], []
    for path, detections in read.detections:
        for where, rig in read.rigs:
            try:
                matched, chosen, notes = match_views(rig, detections, options)
            except PosefuseError as error:
                refused.append(str(error))
                continue
            views = count(chosen.n_views, "view")
            words = f"{views} {'matches' if chosen.n_views == 1 else 'match'} {count(len(matched), 'camera')}"
            said.append((words, f"  --calibration '{where}'\n  --keypoints '{path}'", notes))
    if refused and not said:
        warn(f"views and cameras do not match: {refused[0]}")
    told: set[str] = set()
    for words, flags, notes in said:
        for remark in notes:
            if remark not in told:
                note(f"note: {remark}")
        told.update(notes)
        say(
            f"{words}; posefuse reconstruct can process this folder"
            if single
            else f"{words}; to reconstruct, add\n{flags}"
        )
    return bool(said)
