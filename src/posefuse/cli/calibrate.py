"""``posefuse calibrate``."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Group, Parameter

from posefuse.calibration.boards.calibration import BoardCalibration
from posefuse.calibration.people.result import PeopleCalibration
from posefuse.cli.calibrate_board import describe_board
from posefuse.cli.calibrate_people import describe_people
from posefuse.cli.calibrate_scene import describe_scene
from posefuse.cli.console import Bars, note
from posefuse.cli.types import JobsFlag, KeypointsPath, Overwrite, TimestampsPath
from posefuse.errors import CalibrationError, FileError, choices
from posefuse.model.options.bounds import option
from posefuse.model.options.calibration import CalibrateOptions, PeopleOptions

if TYPE_CHECKING:
    from posefuse.model.cameras import CameraRig

Source = Annotated[
    Path | None,
    Parameter(
        help="Folder of videos or folders of pictures of a --board, one per camera, or of 2D keypoints of people, or "
        "of both."
    ),
]
CalibrationOutput = Annotated[
    Path, Parameter(name=["--output", "-o"], help="Calibration file to write, in Anipose's format (name.toml).")
]


@dataclass(frozen=True)
class CalibrationInputs:
    """Flags that name what is known about the cameras and the scene."""

    board: Annotated[
        str | None,
        Parameter(
            help="Board, such as charuco:7x5,square=30mm,marker=0.75,dict=4X4_50 or checkerboard:4x7,square=60mm "
            "(inner corners), or its file: TOML of posefuse, Caliscope or Anipose."
        ),
    ] = None
    scene_points: Annotated[
        Path | None,
        Parameter(help="TOML or CSV file of points of known position and their places in the image of each camera."),
    ] = None
    origin_points: Annotated[
        Path | None,
        Parameter(help="File of known points that define the world."),
    ] = None
    intrinsics: Annotated[Path | None, Parameter(help="Calibration file with known lenses; others are estimated.")] = (
        None
    )
    earlier: Annotated[
        Path | None,
        Parameter(
            name="--from",
            help="Earlier calibration of these cameras, some of which were moved since; its lenses and world are kept.",
        ),
    ] = None
    keypoints: KeypointsPath = None
    timestamps: TimestampsPath = None


_NO_FLAG = Parameter(parse=False)


@dataclass(frozen=True)
class BoardFlags(CalibrateOptions):
    """Flags of a calibration by a board; the number of processes is one flag of both kinds of calibration."""

    jobs: Annotated[int | None, _NO_FLAG] = option(None, at_least=1, unit="")


@dataclass(frozen=True)
class PeopleFlags(PeopleOptions):
    """Flags of a calibration by people; the number of processes likewise."""

    jobs: Annotated[int | None, _NO_FLAG] = option(None, at_least=1, unit="")


def calibrate(
    recording: Source = None,
    *,
    output: CalibrationOutput,
    inputs: Annotated[CalibrationInputs, Parameter(name="*")] = CalibrationInputs(),
    report: Annotated[bool, Parameter(help="Write a report beside the calibration (name.html).")] = True,
    overwrite: Overwrite = False,
    jobs: JobsFlag = "auto",
    options: Annotated[BoardFlags, Parameter(name="*", group=Group("Options with --board", sort_key=2))] = BoardFlags(),
    people: Annotated[
        PeopleFlags, Parameter(name="*", group=Group("Options without --board", sort_key=3))
    ] = PeopleFlags(),
) -> None:
    """Calibrate cameras by a board, by the people or animals that they film, or by points of known position.

    Estimates lenses, poses and time offsets with standard deviations, and states what to film next.
    """
    page = output.with_suffix(".html") if report else None
    _check_outputs(output, page, overwrite=overwrite)
    given = _with_jobs(options, people, jobs, has_board=inputs.board is not None)
    if inputs.scene_points is not None:
        if inputs.origin_points is not None:
            raise CalibrationError("The scene points define the world already: remove `origin_points`.")
        rig = _by_scene(inputs.scene_points, recording, inputs, given.board, page)
    else:
        rig = _by_target(recording, inputs, given, page)
    _write(rig, output, page)


@dataclass(frozen=True)
class _Given:
    """Options of either kind that the user gives, or None."""

    board: CalibrateOptions | None
    people: PeopleOptions | None


def _with_jobs(options: BoardFlags, people: PeopleFlags, jobs: int | Literal["auto"], *, has_board: bool) -> _Given:
    """Return the options given, with the number of processes in those of the kind of calibration."""
    by_board = None if options == BoardFlags() else options
    by_people = None if people == PeopleFlags() else people
    if jobs == "auto":
        return _Given(by_board, by_people)
    if has_board:
        return _Given(replace(options, jobs=jobs), by_people and replace(people, jobs=jobs))
    return _Given(by_board, replace(people, jobs=jobs))


def _by_scene(
    scene_points: Path,
    images: Path | None,
    inputs: CalibrationInputs,
    options: CalibrateOptions | None,
    page: Path | None,
) -> "CameraRig":
    """Calibrate by points of known position, print the result, and write the report."""
    from posefuse.pipeline.calibrate_scene import calibrate_scene
    from posefuse.pipeline.calibration_report import write_calibration_report

    result = calibrate_scene(
        scene_points, images, inputs.board, intrinsics=inputs.intrinsics, options=options, progress=Bars()
    )
    describe_scene(result)
    if page is not None:
        write_calibration_report(result, page)
    return result.rig


def _by_target(
    recording: Path | None,
    inputs: CalibrationInputs,
    given: _Given,
    page: Path | None,
) -> "CameraRig":
    """Calibrate by a board or by people, print the result, and write the report."""
    from posefuse.pipeline.calibrate import calibrate as run
    from posefuse.pipeline.calibration_report import write_calibration_report

    if recording is None:
        raise CalibrationError(
            "Give the folder of the videos of a board and its `board`, the folder of a recording of people, or "
            "`scene_points`."
        )
    if inputs.earlier is not None:
        result = _from_earlier(recording, inputs.earlier, inputs, given)
    else:
        result = run(
            recording, inputs.board, intrinsics=inputs.intrinsics, keypoints=inputs.keypoints,
            timestamps=inputs.timestamps, options=given.board, people=given.people, progress=Bars(),
        )  # fmt: skip
    if inputs.origin_points is not None:
        from posefuse.pipeline.place_calibration import place_calibration

        result = place_calibration(result, inputs.origin_points)
    if isinstance(result, PeopleCalibration):
        describe_people(result)
    else:
        describe_board(result)
    if page is not None:
        write_calibration_report(result, page)
    return result.rig


def _from_earlier(
    recording: Path, earlier: Path, inputs: CalibrationInputs, given: _Given
) -> BoardCalibration | PeopleCalibration:
    """Calibrate after cameras were moved."""
    from posefuse.pipeline.recalibrate import recalibrate

    if inputs.intrinsics is not None:
        raise CalibrationError("The lenses are those of the earlier calibration: remove `intrinsics`.")
    return recalibrate(
        recording, inputs.board, earlier, keypoints=inputs.keypoints, timestamps=inputs.timestamps,
        options=given.board, people=given.people, progress=Bars(),
    )  # fmt: skip


def _check_outputs(output: Path, page: Path | None, *, overwrite: bool) -> None:
    """Refuse a name or existing files before any work is done."""
    from posefuse.io.calibration.anipose import FORMAT
    from posefuse.io.outputs import check_new_files

    if not output.name.endswith(FORMAT.file_endings):
        raise FileError(f"{output}: the name of the calibration must end in {choices(FORMAT.file_endings)}.")
    check_new_files([output] if page is None else [output, page], overwrite=overwrite)


def _write(rig: "CameraRig", output: Path, page: Path | None) -> None:
    """Write the calibration after its report, so that a failure leaves no calibration."""
    from posefuse.io.calibration.anipose import FORMAT, write

    write(rig, output)
    note(f"Wrote {output} in the format {FORMAT.name}" + ("" if page is None else f", and {page}"))
