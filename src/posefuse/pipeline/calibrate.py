"""Calibrate cameras by a board, or by the people that they film."""

from pathlib import Path
from typing import overload

from posefuse.arguments import checked
from posefuse.calibration.boards.calibration import BoardCalibration
from posefuse.calibration.people.result import PeopleCalibration
from posefuse.errors import OptionsError
from posefuse.io.board_images import find_board_folder
from posefuse.io.recording import find_recording
from posefuse.model.board import Board
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.calibration import CalibrateOptions, PeopleOptions
from posefuse.pipeline.calibrate_people import PeopleSource
from posefuse.pipeline.refuse_options import refuse_options
from posefuse.progress import Progress, Silent


@overload
def calibrate(
    recording: str | Path,
    board: Board | str | Path,
    *,
    intrinsics: CameraRig | str | Path | None = None,
    timestamps: str | Path | None = None,
    keypoints: None = None,
    options: CalibrateOptions | None = None,
    people: None = None,
    progress: Progress | None = None,
) -> BoardCalibration: ...


@overload
def calibrate(
    recording: Detections | str | Path,
    board: None = None,
    *,
    intrinsics: CameraRig | str | Path | None = None,
    keypoints: str | Path | None = None,
    timestamps: str | Path | None = None,
    people: PeopleOptions | None = None,
    progress: Progress | None = None,
) -> PeopleCalibration: ...


@overload
def calibrate(
    recording: Detections | str | Path,
    board: Board | str | Path | None = None,
    *,
    intrinsics: CameraRig | str | Path | None = None,
    keypoints: str | Path | None = None,
    timestamps: str | Path | None = None,
    options: CalibrateOptions | None = None,
    people: PeopleOptions | None = None,
    progress: Progress | None = None,
) -> BoardCalibration | PeopleCalibration: ...


@checked
def calibrate(
    recording: Detections | str | Path,
    board: Board | str | Path | None = None,
    *,
    intrinsics: CameraRig | str | Path | None = None,
    keypoints: str | Path | None = None,
    timestamps: str | Path | None = None,
    options: CalibrateOptions | None = None,
    people: PeopleOptions | None = None,
    progress: Progress | None = None,
) -> BoardCalibration | PeopleCalibration:
    """Calibrate cameras by a board that they see, or by the people or animals that they film.

    Args:
        recording: with a board: folder with one video, or one folder of pictures, per camera; without one: folder of a
            recording with 2D keypoints, or keypoints in memory. A folder with both, or ``keypoints`` beside images of a
            board, is calibrated by the board and the people in one estimate.
        board: the board, its description such as ``charuco:7x5,square=30mm``, or a file that describes it; None to
            calibrate by people. Views of people may start seconds apart (``people.max_offset_s``) and have different
            frame rates, identities need not agree across views, and left and right sides may be exchanged.
        intrinsics: cameras with known lenses, or a calibration file, whose poses are not used; lenses of cameras that
            it does not name are estimated.
        keypoints: file or folder of keypoints of people; by default those in the recording.
        timestamps: file or folder of frame times; by default those in the recording.
        options: further options of a calibration by a board.
        people: further options of a calibration by people, such as their stature.
        progress: receives the progress.

    Returns:
        The cameras with their uncertainty; a :class:`PeopleCalibration` where people take part. The world is the first
        camera, the board of ``origin_frame``, or the floor that people stand on.

    Raises:
        CalibrationError: if the recording does not determine the cameras; the message states what to film.
        FileError: if a file cannot be read.
        OptionsError: if options of the other kind of calibration are given.
        RecordingError: if the folder has no images or keypoints, or several sets of them.
    """
    if board is None:
        from posefuse.pipeline.calibrate_people import calibrate_by_people

        refuse_options("board", options=options)
        return calibrate_by_people(
            recording, intrinsics=intrinsics, keypoints=keypoints, timestamps=timestamps, options=people,
            progress=progress,
        )  # fmt: skip
    if isinstance(recording, Detections):
        raise OptionsError("A calibration by a board reads images: `recording` must be their folder.")
    images, has_people = _board_and_people(Path(recording), keypoints)
    if has_people:
        from posefuse.pipeline.calibrate_combined import calibrate_combined

        options = options or CalibrateOptions()
        return calibrate_combined(
            images, board, PeopleSource(recording, keypoints, timestamps), intrinsics=intrinsics,
            options=options, people=people or PeopleOptions(jobs=options.jobs), progress=progress or Silent(),
        )  # fmt: skip
    from posefuse.pipeline.calibrate_board import calibrate_by_board

    refuse_options(None, people=people)
    return calibrate_by_board(
        recording, board, intrinsics=intrinsics, timestamps=timestamps, options=options, progress=progress
    )


def _board_and_people(folder: Path, keypoints: str | Path | None) -> tuple[Path, bool]:
    """Return the folder with images of the board, and whether there are 2D keypoints of people, too."""
    if not folder.is_dir() or (keypoints is None and not find_recording(folder).keypoints):
        return folder, False
    inside = find_board_folder(folder)
    return (folder if inside is None or folder.resolve() not in inside.parents else inside), True
