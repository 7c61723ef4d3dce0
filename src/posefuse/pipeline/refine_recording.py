"""Refine the calibration of a recording and write it."""

from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Literal

from posefuse.calibration.outcome import Refinement, with_slow_errors
from posefuse.errors import FileError
from posefuse.io.boards import find_board, read_board
from posefuse.io.calibration.read import read_cameras
from posefuse.io.calibration.write import check_name, write_like
from posefuse.io.keypoints.read import read_keypoints
from posefuse.io.keypoints.request import Request
from posefuse.io.open_recording import RecordingInputs, digest_path
from posefuse.io.outputs import check_new_files
from posefuse.io.recording import choose_calibration, choose_keypoints, find_recording
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.options.refinement import RefineOptions
from posefuse.parallel import Jobs, number_of_jobs
from posefuse.pipeline.diagnose import begin_judging
from posefuse.pipeline.plan import useful_jobs
from posefuse.pipeline.refine_calibration import refine_calibration
from posefuse.progress import Progress, Silent

Source = Literal["keypoints", "board"]
"""What a calibration is refined by: the keypoints of a moving subject, or the corners of a board."""


def refine_recording(
    recording: Path,
    output: Path,
    options: Options | None = None,
    refining: RefineOptions | None = None,
    *,
    source: Source = "keypoints",
    inputs: RecordingInputs | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> tuple[Refinement, str]:
    """Refine the calibration of a recording and write the refined one.

    Args:
        recording: folder of the recording.
        output: file to write, in the format of the calibration if it is Pose2Sim's or Qualisys', else in Anipose's.
        options: views and frames to use, and how they are triangulated.
        refining: parameters to refine.
        source: what to refine by.
        inputs: paths of inputs that are not found in the folder or are ambiguous there.
        overwrite: whether to replace an existing file.
        progress: receives the progress.

    Returns:
        The refinement and the name of the format written.

    Raises:
        CalibrationError: if the observations do not determine the cameras.
        FileError: if the output is the calibration itself, or cannot be written.
        OutputExistsError: if the output exists and ``overwrite`` is False.
    """
    options, refining, progress = options or Options(), refining or RefineOptions(), progress or Silent()
    calibration, rig, detections = _read(recording, inputs or RecordingInputs(), source, options, progress)
    if output.exists() and output.resolve() == calibration.resolve():
        raise FileError(
            f"`output={str(output)!r}` is the calibration to refine, which is never overwritten. Choose another file."
        )
    check_new_files([output], overwrite=overwrite)
    check_name(output, calibration)
    if source == "board":
        options, refining = replace(options, people="one"), replace(refining, rigid=True)
    if source == "board":
        result = refine_calibration(rig, detections, options, refining, progress=progress)
    else:
        result = refine_by_keypoints(rig, detections, options, refining, progress)
    return result, write_like(_with_notes(result, calibration, source), output, calibration)


def refine_by_keypoints(
    rig: CameraRig, detections: Detections, options: Options, refining: RefineOptions, progress: Progress
) -> Refinement:
    """Refine a calibration by people, with what the recording check says, and at least its standard deviations.

    With several processes, one checks the recording while the calibration is refined.

    Args:
        rig: the original calibration.
        detections: keypoints of the recording.
        options: views and frames to use, and how they are triangulated.
        refining: parameters to refine.
        progress: receives the progress.

    Raises:
        CalibrationError: if the observations do not determine the cameras.
    """
    with Jobs(number_of_jobs(refining.jobs or "auto", useful_jobs(detections))) as jobs:
        judged = begin_judging(rig, detections, options, jobs)
        result = refine_calibration(rig, detections, options, refining, progress=progress)
        findings, sds = judged()
    cameras = tuple(with_slow_errors(camera, *sds.get(camera.name, (0.0, 0.0))) for camera in result.cameras)
    return replace(result, findings=findings, cameras=cameras)


def _read(
    recording: Path, inputs: RecordingInputs, source: Source, options: Options, progress: Progress
) -> tuple[Path, CameraRig, Detections]:
    """Return the path of the calibration, its cameras, and their observations."""
    calibration, keypoints = inputs.calibration, inputs.keypoints
    found = find_recording(recording) if calibration is None or (keypoints is None and source == "keypoints") else None
    if found is not None and keypoints is None and source == "keypoints":
        keypoints = choose_keypoints(found)
    if found is not None:
        calibration = calibration or choose_calibration(found)
    assert calibration is not None
    rig = read_cameras(calibration, length_unit=options.length_unit, up=options.up)
    if source == "board":
        return calibration, rig, read_board(keypoints or find_board(recording), rig.names)
    assert keypoints is not None
    return calibration, rig, read_keypoints(keypoints, Request.of(options, progress))


def _with_notes(result: Refinement, calibration: Path, source: Source) -> CameraRig:
    """Return the refined rig with notes on how it was made, without clock or path."""
    frames = f"{result.n_held_out} frame" + ("" if result.n_held_out == 1 else "s")
    notes = [
        f"Refined by posefuse {version('posefuse')} refine-calibration ({result.refine}, by {source}) from "
        f"{calibration.name} (SHA-256 {digest_path(calibration)}).",
        f"Median error in {frames} held out: {result.before_px:.2f} px before, {result.after_px:.2f} px after.",
    ]
    for camera in result.cameras:
        if camera.role == "left out":
            notes.append(f"Camera {camera.name!r} was left out: {camera.why}")
        elif camera.role == "located":
            notes.append(f"Camera {camera.name!r} was located without its initial pose.")
        elif camera.role == "fixed":
            notes.append(f"Camera {camera.name!r} was not refined.")
    return replace(result.rig, notes=tuple(notes), left_out=result.left_out)
