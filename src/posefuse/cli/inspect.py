"""``posefuse inspect``."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar

import numpy as np
from cyclopts import Parameter

from posefuse.cli.console import Bars, count, detail, note, notes, percent, say, table, warn
from posefuse.cli.findings import AcceptFindings, exit_on_certain_faults
from posefuse.cli.types import (
    CalibrationPath,
    JobsFlag,
    KeypointsPath,
    OptionFlags,
    Recording,
    SyncPath,
    TimestampsPath,
    with_sync,
)
from posefuse.errors import PosefuseError, RecordingError, choices
from posefuse.io.open_recording import has_times, keypoint_request
from posefuse.io.recording import Ignored, RecognizedInput, find_recording, ignored_in
from posefuse.io.videos_only import videos_only
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.findings import Finding
from posefuse.model.options.options import Options
from posefuse.parallel import JobCount, number_of_jobs
from posefuse.skeleton.subject_words import subject_words

_MOST_CAMERAS = {False: 8, True: 24}
"""Rows of a table of cameras or views, without and with ``--verbose``."""
_MOST_NAMES = {False: 1, True: 4}
_MOST_REASONS = 3
_SMALL_RIG_M = 1.0
_IN_FULL = "with --verbose"


@dataclass(frozen=True)
class _Inputs:
    """Calibrations and keypoints that could be read, with their paths."""

    rigs: list[tuple[Path, CameraRig]]
    detections: list[tuple[Path, Detections]]


@dataclass(frozen=True)
class CheckFlags:
    """Flags of the recording check."""

    deep: Annotated[bool, Parameter(negative="", help="Check the recording for faults by its detections.")] = False
    accept_findings: AcceptFindings = False
    jobs: JobsFlag = "auto"


def inspect(
    recording: Recording,
    *,
    calibration: CalibrationPath = None,
    keypoints: KeypointsPath = None,
    timestamps: TimestampsPath = None,
    sync: SyncPath = None,
    check: Annotated[CheckFlags, Parameter(name="*")] = CheckFlags(),
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Show the calibrations and keypoints in a folder, how they were recognized, and whether they match.

    The exit code is 1 if no calibration or no keypoints of those found can be read.

    With --deep, also check the recording for faults: moved cameras, time offsets, rotated images, and more. The exit
    code is then 3 if a fault is certain that makes results wrong; --accept-findings makes it 0.
    """
    number_of_jobs(check.jobs, useful=1)
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
    rigs = _show_all(calibrations, partial(_read_rig, options=options), _RIG, recording)
    read = partial(_read_keypoints, recording=recording, timestamps=timestamps, options=options)
    seen = _show_all(keypoint_sets, read, _KEYPOINTS, recording)
    if not keypoint_sets:
        note(videos_only(recording) or "no 2D keypoints")
    if not calibrations:
        say("no calibration")
        if len(seen) == 1 and seen[0][1].n_views == 1 and options.needs_no_poses:
            say("1 view needs no calibration; posefuse reconstruct gives its points in px")
    _say_ignored(ignored_in(found))
    matched = _say_matches(_Inputs(rigs, seen), options)
    _refuse_unreadable((calibrations, rigs, _RIG), (keypoint_sets, seen, _KEYPOINTS))
    if check.deep and len(rigs) == len(seen) == 1:
        if matched:
            findings = _examine(rigs[0][1], seen[0][1], options, check.jobs)
            exit_on_certain_faults(findings, check.accept_findings, "results are")
    elif check.deep:
        raise RecordingError(
            "--deep needs one calibration and one set of keypoints. Add --calibration FILE and --keypoints PATH."
        )


def _refuse_unreadable(*kinds: tuple[Sequence[RecognizedInput], Sequence[object], "_Kind[Any]"]) -> None:
    """Raise RecordingError if there are inputs of a kind, but none of them could be read; the reasons are printed."""
    unreadable = [kind.name if len(items) == 1 else kind.title for items, read, kind in kinds if items and not read]
    if unreadable:
        raise RecordingError(
            f"The {' and the '.join(unreadable)} cannot be read, for the reasons above. posefuse formats lists the "
            "known formats."
        )


def _given(path: Path, *, calibration: bool) -> RecognizedInput:
    """Return the path that the user gives, with its format."""
    from posefuse.io.calibration.read import find_format as calibration_format
    from posefuse.io.keypoints.read import find_format as keypoint_format

    form = (calibration_format if calibration else keypoint_format)(path)
    return RecognizedInput(path, "unknown") if form is None else RecognizedInput(path, form.name, form.recognized_by)


def _examine(rig: CameraRig, detections: Detections, options: Options, jobs: JobCount) -> tuple[Finding, ...]:
    """Print and return the findings of the recording check, the most severe first."""
    from posefuse.cli.verdict import say_verdict
    from posefuse.pipeline.diagnose import inspect_health

    if detections.n_views < 2:
        say("recording check: nothing checked, because the views of one camera cannot contradict each other")
        return ()
    found = inspect_health(rig, detections, options, progress=Bars(), jobs=jobs)
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


_Input = TypeVar("_Input", CameraRig, Detections)


@dataclass(frozen=True)
class _Kind(Generic[_Input]):
    """How one kind of input is shown.

    Attributes:
        name: name of one input.
        title: name of several.
        columns: columns of the table of several, between format and path.
        row: cells of an input in that table.
        show: prints all about one input.
    """

    name: str
    title: str
    columns: tuple[str, ...]
    row: Callable[[_Input], tuple[str, ...]]
    show: Callable[[_Input], None]


def _show_all(
    items: Sequence[RecognizedInput], read: Callable[[RecognizedInput], _Input], kind: _Kind[_Input], folder: Path
) -> list[tuple[Path, _Input]]:
    """Print inputs of one kind, in full if there is one or with ``--verbose``, else a row each; return those read."""
    brief = len(items) > 1 and not detail.verbose
    readable, rows = [], []
    for item in items:
        if not brief:
            say(f"{kind.name} {item.path} ({item.format})")
            if item.recognized_by and detail.verbose:
                note(f"  recognized by: {item.recognized_by}")
        try:
            one = read(item)
        except PosefuseError as error:
            note(f"{item.path} ({item.format}) cannot be read: {error}" if brief else f"  cannot be read: {error}")
            continue
        readable.append((item.path, one))
        if brief:
            rows.append([f"  ({item.format})", *kind.row(one), str(_below(item.path, folder))])
        else:
            kind.show(one)
    if rows:
        title = f"1 {kind.name}" if len(rows) == 1 else f"{len(rows)} {kind.title}"
        table(title, ["  format", *kind.columns, "path"], rows, words=True)
    return readable


def _below(path: Path, folder: Path) -> Path:
    """Return a path relative to a folder that contains it."""
    return path.relative_to(folder) if path != folder and path.is_relative_to(folder) else path


def _say_ignored(ignored: Sequence[Ignored]) -> None:
    """Print the files that are not read, with reasons where these take few lines."""
    if not ignored:
        return
    if len(ignored) <= _MOST_REASONS or detail.verbose:
        say("not read:")
        for item in ignored:
            note(f"  {choices(item.names, _MOST_NAMES[detail.verbose])}: {item.reason}")
        return
    names = [name for item in ignored for name in item.names]
    note(f"not read: {choices(names, 2)}. --verbose gives the reasons.")


def _read_rig(item: RecognizedInput, options: Options) -> CameraRig:
    from posefuse.io.calibration.read import read_cameras

    return read_cameras(item.path, length_unit=options.length_unit, up=options.up)


def _rig_row(rig: CameraRig) -> tuple[str, ...]:
    return str(len(rig)), rig.up_text, f"x {rig.meters_per_unit:g}"


def _show_rig(rig: CameraRig) -> None:
    say(f"  {len(rig)} cameras; up axis {rig.up_text}, lengths x {rig.meters_per_unit:g} to meters")
    notes(rig.notes, _IN_FULL)
    rows = []
    # Positions in a unit that suits the size of the rig.
    apart_m = float(np.ptp([camera.center_m for camera in rig.cameras], axis=0).max())
    unit, scale, digits = ("mm", 1000.0, 0) if apart_m < _SMALL_RIG_M else ("m", 1.0, 2)
    for camera in rig.cameras[: _most_cameras()]:
        size = f"{camera.size_px[0]} x {camera.size_px[1]}"
        at = " ".join(f"{scale * value:.{digits}f}" for value in camera.center_m)
        rows.append([f"  {camera.name}", size, f"{camera.matrix[0, 0]:.0f}", str(camera.lens), at])
    table(None, ["  camera", "size px", "focal px", "lens", f"position {unit}"], rows)
    if len(rig) > _most_cameras():
        say(f"  and {len(rig) - _most_cameras()} more, up to {rig.names[-1]}")


def _most_cameras() -> int:
    return _MOST_CAMERAS[detail.verbose]


def _read_keypoints(item: RecognizedInput, recording: Path, timestamps: Path | None, options: Options) -> Detections:
    from posefuse.io.keypoints.read import read_keypoints

    return read_keypoints(item.path, keypoint_request(recording, item.path, options, Bars(), timestamps))


def _keypoints_row(detections: Detections) -> tuple[str, ...]:
    people = detections.people_counts[detections.recorded]
    span = f"{people.min()} to {people.max()}" if len(people) else "0"
    return detections.skeleton.name, str(detections.n_views), str(detections.n_frames), span


def _show_keypoints(detections: Detections) -> None:
    rate = "unknown (--rate-hz)" if detections.rate_hz is None else f"{detections.rate_hz:g} Hz"
    first, last = detections.frame_numbers[[0, -1]]
    say(f"  skeleton {detections.skeleton.name}, {len(detections.skeleton)} keypoints; rate {rate}")
    say(f"  frames {first} to {last}{_span(detections)}")
    notes(detections.notes, _IN_FULL)
    _views_table(detections)


_RIG: _Kind[CameraRig] = _Kind("calibration", "calibrations", ("cameras", "up axis", "to meters"), _rig_row, _show_rig)
_KEYPOINTS: _Kind[Detections] = _Kind(
    "keypoints", "sets of keypoints", ("skeleton", "views", "frames", "subjects"), _keypoints_row, _show_keypoints
)


def _span(detections: Detections) -> str:
    """Return the time span as text, empty if times are unknown."""
    times = detections.time_s[np.isfinite(detections.time_s)]
    return f", {times.min():.3f} to {times.max():.3f} s" if len(times) else ""


def _views_table(detections: Detections) -> None:
    counts = detections.people_counts
    missing = _missing_shares(detections)
    rows = []
    for v, name in enumerate(detections.view_names[: _most_cameras()]):
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
    several = subject_words(detections.skeleton)[1]
    table(None, ["  view", "frames", "missing", "Hz", several, "keypoints missing"], rows)
    if detections.n_views > _most_cameras():
        say(f"  and {detections.n_views - _most_cameras()} more, up to {detections.view_names[-1]}")


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
                matched, chosen, remarks = match_views(rig, detections, options)
            except PosefuseError as error:
                refused.append(str(error))
                continue
            views = count(chosen.n_views, "view")
            words = f"{views} {'matches' if chosen.n_views == 1 else 'match'} {count(len(matched), 'camera')}"
            untimed = not has_times(chosen) and options.people != "stills"
            flags = f"  --calibration '{where}'\n  --keypoints '{path}'" + ("\n  --rate-hz HZ" if untimed else "")
            said.append((words, flags, untimed, remarks))
    if refused and not said:
        warn(f"views and cameras do not match: {refused[0]}")
    notes(list(dict.fromkeys(remark for *_, remarks in said for remark in remarks)), _IN_FULL)
    if said and single:
        words, _, untimed, _ = said[0]
        given = " with --rate-hz HZ, since the keypoint files do not specify their frame rate" if untimed else ""
        say(f"{words}; posefuse reconstruct can process this folder{given}")
    elif detail.verbose or len(said) == 1:
        for words, flags, *_ in said:
            say(f"{words}; to reconstruct, add\n{flags}")
    elif said:
        pairs = len(read.rigs) * len(read.detections)
        say(f"{len(said)} of {pairs} pairs match. To reconstruct, choose one (--verbose lists them), such as")
        say(said[0][1])
    return bool(said)
