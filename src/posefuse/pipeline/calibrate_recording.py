"""Calibrate the cameras of a recording that has images of a board instead of a calibration."""

from pathlib import Path
from typing import TYPE_CHECKING

from posefuse.errors import CalibrationError
from posefuse.io.board_images import find_board_folder
from posefuse.io.board_specs import find_board_spec
from posefuse.io.files import replacing
from posefuse.io.open_recording import RecordingInputs
from posefuse.io.recording import CALIBRATION_FILE, find_recording
from posefuse.progress import Progress

# Calibration is a fifth of the package, and few recordings need it, so each function imports it when it is called.
if TYPE_CHECKING:
    from posefuse.calibration.boards.calibration import BoardCalibration
    from posefuse.calibration.people.result import PeopleCalibration


def ensure_calibration(folder: Path, inputs: RecordingInputs, progress: Progress | None = None) -> Path | None:
    """Calibrate the cameras of a recording, unless it has a calibration or no images of a known board.

    Images inside the recording are used together with its people, as :func:`posefuse.calibrate` does for the same
    folder. Images above it serve all recordings of a session, so they are used alone. The calibration and its report
    are written into the recording, or beside the images above it, where the other recordings find them, too.

    Args:
        folder: folder of the recording.
        inputs: paths of its inputs, and the board.
        progress: receives the progress.

    Returns:
        The calibration that was written, or None.

    Raises:
        CalibrationError: if the images do not determine the cameras.
        PosefuseError: if a file cannot be read.
    """
    if inputs.calibration is not None or not folder.is_dir():
        return None
    images = find_board_folder(folder)
    if images is None:
        return None
    board = inputs.board or find_board_spec((images, folder))
    if board is None:
        return None
    recording = find_recording(folder)
    if recording.calibrations or not (recording.keypoints or inputs.keypoints):
        return None
    if images.parent != folder.resolve():
        return calibrate_images(images, board, images / CALIBRATION_FILE, progress)
    from posefuse.pipeline.calibrate import calibrate

    result = calibrate(folder, board, keypoints=inputs.keypoints, timestamps=inputs.timestamps, progress=progress)
    return _write(result, images, folder / CALIBRATION_FILE)


def calibrate_images(images: Path, board: str | Path, target: Path, progress: Progress | None = None) -> Path:
    """Calibrate the cameras of a session by images of a board alone, and write the calibration with its report.

    Args:
        images: folder of the images.
        board: description of the board, or its file.
        target: calibration file to write.
        progress: receives the progress.

    Raises:
        CalibrationError: if the images do not determine the cameras.
        PosefuseError: if a file cannot be read.
    """
    from posefuse.pipeline.calibrate_board import calibrate_by_board

    return _write(calibrate_by_board(images, board, progress=progress), images, target)


def _write(result: "PeopleCalibration | BoardCalibration", images: Path, target: Path) -> Path:
    from posefuse.calibration.assessment import assess
    from posefuse.calibration.boards.summary import summarize_board
    from posefuse.calibration.people.result import PeopleCalibration
    from posefuse.calibration.people.summary import summarize_people
    from posefuse.io.calibration.anipose import write
    from posefuse.pipeline.calibration_report import write_calibration_report

    summary = summarize_people(result) if isinstance(result, PeopleCalibration) else summarize_board(result)
    assessment = assess(summary)
    if assessment.level == "bad":
        raise CalibrationError(f"Calibration from {images}: {assessment.sentence} {assessment.advice[0]}")
    write_calibration_report(summary, target.with_suffix(".html"))
    with replacing(target) as temporary:
        write(result.rig, temporary)
    return target
