"""``posefuse inspect``."""

from typing import Annotated

import numpy as np
from cyclopts import Parameter

from posefuse.cli.console import Bars, count, percent, say, table
from posefuse.cli.types import CalibrationPath, KeypointsPath, OptionFlags, Recording
from posefuse.errors import PosefuseError, RecordingError
from posefuse.io.recording import Found, find_recording
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options import Options


def inspect(
    recording: Recording,
    *,
    calibration: CalibrationPath = None,
    keypoints: KeypointsPath = None,
    deep: Annotated[bool, Parameter(negative="", help="Look for what is wrong, from the detections.")] = False,
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Say what is in a folder: calibrations, keypoints, and whether they belong together.

    With --deep also what is wrong with them: cameras that moved, views out of step, images turned, and more.
    """
    found = find_recording(recording)
    calibrations = found.calibrations if calibration is None else (Found(calibration, ""),)
    keypoint_sets = found.keypoints if keypoints is None else (Found(keypoints, ""),)
    if not calibrations and not keypoint_sets:
        raise RecordingError(
            f"Nothing in {recording} is a calibration or 2D keypoints in a known format; posefuse formats lists them."
        )
    rigs = [rig for item in calibrations if (rig := _calibration(item, options)) is not None]
    detections = [seen for item in keypoint_sets if (seen := _keypoints(item, options)) is not None]
    if len(rigs) == 1 and len(detections) == 1:
        matched = _match(rigs[0], detections[0], options)
        if deep and matched:
            _examine(rigs[0], detections[0], options)
    elif deep:
        raise RecordingError(
            "--deep looks at one calibration and one set of keypoints. Say which: --calibration FILE, --keypoints PATH."
        )


def _examine(rig: CameraRig, detections: Detections, options: Options) -> None:
    """Say what is wrong, the worst first."""
    from posefuse.pipeline import inspect_health

    found = inspect_health(rig, detections, options, progress=Bars())
    if not found:
        say("health: nothing wrong was found")
        return
    say(f"health: {count(len(found), 'finding')}, the worst first")
    for number, finding in enumerate(found, 1):
        say(f"{number}. {finding.kind}: {finding.sentence}")
        say(f"   {100 * finding.certainty:.0f} % certain. {finding.remedy}")


def _calibration(item: Found, options: Options) -> CameraRig | None:
    from posefuse.io.calibration.read import find_format, read_cameras

    form = item.format or getattr(find_format(item.path), "name", "unknown")
    say(f"calibration {item.path} ({form})")
    try:
        rig = read_cameras(item.path, length_unit=options.length_unit, up=options.up)
    except PosefuseError as error:
        say(f"  cannot be read: {error}")
        return None
    say(f"  up axis {rig.up_axis or 'unknown'}, lengths x {rig.metres_per_unit:g} to metres")
    for note in rig.notes:
        say(f"  note: {note}")
    rows = []
    for camera in rig.cameras:
        size = f"{camera.size_px[0]} x {camera.size_px[1]}"
        at = " ".join(f"{value:.2f}" for value in camera.centre_m)
        rows.append([f"  {camera.name}", size, f"{camera.matrix[0, 0]:.0f}", str(camera.lens), at])
    table(None, ["  camera", "size px", "focal px", "lens", "at m"], rows)
    return rig


def _keypoints(item: Found, options: Options) -> Detections | None:
    from posefuse.io.keypoints.read import find_format, read_keypoints
    from posefuse.io.keypoints.request import Request

    form = item.format or getattr(find_format(item.path), "name", "unknown")
    say(f"keypoints {item.path} ({form})")
    try:
        detections = read_keypoints(item.path, Request.of(options, Bars()))
    except PosefuseError as error:
        say(f"  cannot be read: {error}")
        return None
    rate = "unknown (--rate-hz)" if detections.rate_hz is None else f"{detections.rate_hz:g} Hz"
    first, last = detections.frame_numbers[[0, -1]]
    say(f"  skeleton {detections.skeleton.name}, {len(detections.skeleton)} keypoints; rate {rate}")
    say(f"  frames {first} to {last}")
    for note in detections.notes:
        say(f"  note: {note}")
    counts = detections.people_counts
    missing = _missing_shares(detections)
    rows = [
        [
            f"  {name}",
            str(int(detections.recorded[:, v].sum())),
            f"{counts[:, v].min()} to {counts[:, v].max()}",
            percent(missing[v]),
        ]
        for v, name in enumerate(detections.view_names)
    ]
    table(None, ["  view", "frames", "people", "keypoints missing"], rows)
    return detections


def _missing_shares(detections: Detections) -> np.ndarray:
    """Shape (view,): share of the keypoints of the people there are that were not detected."""
    missing = np.zeros(detections.n_views)
    total = np.zeros(detections.n_views)
    for chunk in detections.chunks():
        views = np.repeat(np.tile(np.arange(chunk.n_views), chunk.n_frames), np.diff(chunk.offsets))
        absent = np.isnan(np.asarray(chunk.keypoints_px)).any(axis=-1)
        missing += np.bincount(views, absent.sum(axis=1), minlength=chunk.n_views)
        total += np.bincount(views, minlength=chunk.n_views) * len(chunk.skeleton)
    return missing / np.maximum(total, 1)


def _match(rig: CameraRig, detections: Detections, options: Options) -> bool:
    from posefuse.pipeline import match_views

    try:
        matched, chosen, notes = match_views(rig, detections, options)
    except PosefuseError as error:
        say(f"views and cameras do not match: {error}")
        return False
    for note in notes:
        say(f"note: {note}")
    say(f"{chosen.n_views} views match {len(matched)} cameras; posefuse reconstruct can take this folder")
    return True
