"""Calibrate cameras by a board, or by the people that they film."""

from dataclasses import fields
from pathlib import Path
from typing import overload

from posefuse.arguments import checked
from posefuse.calibration.boards.calibration import BoardCalibration
from posefuse.calibration.people.result import PeopleCalibration
from posefuse.errors import OptionsError
from posefuse.model.board import Board
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.calibration import CalibrateOptions, PeopleOptions
from posefuse.progress import Progress


@overload
def calibrate(
    recording: str | Path,
    board: Board | str | Path,
    *,
    intrinsics: CameraRig | str | Path | None = None,
    timestamps: str | Path | None = None,
    options: CalibrateOptions | None = None,
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
            recording with 2D keypoints, or keypoints in memory.
        board: the board, its description such as ``charuco:7x5,square=30mm``, or a file that describes it; None to
            calibrate by people. Views of people may start up to 2 s apart and have different frame rates, identities
            need not agree across views, and left and right sides may be exchanged.
        intrinsics: cameras with known lenses, or a calibration file, whose poses are not used; lenses of cameras that
            it does not name are estimated.
        keypoints: file or folder of keypoints of people; by default those in the recording.
        timestamps: file or folder of frame times; by default those in the recording.
        options: further options of a calibration by a board.
        people: further options of a calibration by people, such as their stature.
        progress: receives the progress.

    Returns:
        The cameras with their uncertainty. The world is the first camera, the board of ``origin_frame``, or the floor
        that people stand on.

    Raises:
        CalibrationError: if the recording does not determine the cameras; the message states what to film.
        FileError: if a file cannot be read.
        OptionsError: if options of the other kind of calibration are given.
        RecordingError: if the folder has no images or keypoints, or several sets of them.
    """
    if board is None:
        from posefuse.pipeline.calibrate_people import calibrate_by_people

        _refuse("board", options=options)
        return calibrate_by_people(
            recording, intrinsics=intrinsics, keypoints=keypoints, timestamps=timestamps, options=people,
            progress=progress,
        )  # fmt: skip
    from posefuse.pipeline.calibrate_board import calibrate_by_board

    _refuse(None, keypoints=keypoints, people=people)
    if isinstance(recording, Detections):
        raise OptionsError("A calibration by a board reads images: `recording` must be their folder.")
    return calibrate_by_board(
        recording, board, intrinsics=intrinsics, timestamps=timestamps, options=options, progress=progress
    )


def _refuse(missing: str | None, **given: object) -> None:
    """Raise an error that names an argument, or an option, of the other kind of calibration."""
    names = [_first_change(name, value) for name, value in given.items() if value is not None]
    if names and missing:
        raise OptionsError(f"`{names[0]}` is for calibrations by a board. Set `{missing}`, or remove `{names[0]}`.")
    if names:
        raise OptionsError(f"`{names[0]}` is for calibrations by people. Remove `board`, or remove `{names[0]}`.")


def _first_change(name: str, value: object) -> str:
    """Return the name of the first option that differs from its default, or of the argument."""
    if not isinstance(value, CalibrateOptions | PeopleOptions):
        return name
    usual = type(value)()
    changed = [each.name for each in fields(value) if getattr(value, each.name) != getattr(usual, each.name)]
    return changed[0] if changed else name
