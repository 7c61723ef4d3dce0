"""``posefuse calibrate``."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from posefuse.calibration.boards.calibration import BoardCalibration
from posefuse.calibration.people.result import PeopleCalibration
from posefuse.cli.calibrate_board import describe_board
from posefuse.cli.calibrate_people import describe_people
from posefuse.cli.calibrate_scene import describe_scene
from posefuse.cli.console import Bars, note
from posefuse.cli.types import KeypointsPath, Overwrite, TimestampsPath
from posefuse.errors import CalibrationError, FileError, choices
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


def calibrate(
    recording: Source = None,
    *,
    output: CalibrationOutput,
    inputs: Annotated[CalibrationInputs, Parameter(name="*")] = CalibrationInputs(),
    report: Annotated[bool, Parameter(help="Write a report beside the calibration (name.html).")] = True,
    overwrite: Overwrite = False,
    options: Annotated[
        CalibrateOptions, Parameter(name="*", group=Group("Options with --board", sort_key=2))
    ] = CalibrateOptions(),  # noqa: B008
    people: Annotated[
        PeopleOptions, Parameter(name="*", group=Group("Options without --board", sort_key=3))
    ] = PeopleOptions(),  # noqa: B008
) -> None:
    """Calibrate cameras by a board, by the people or animals that they film, or by points of known position.

    Estimates lenses, poses and time offsets with standard deviations, and states what to film next.
    """
    page = output.with_suffix(".html") if report else None
    _check_outputs(output, page, overwrite=overwrite)
    if inputs.scene_points is not None:
        if inputs.origin_points is not None:
            raise CalibrationError("The scene points define the world already: remove `origin_points`.")
        rig = _by_scene(inputs.scene_points, recording, inputs, options, page)
    else:
        rig = _by_target(recording, inputs, options, people, page)
    _write(rig, output, page)


def _by_scene(
    scene_points: Path, images: Path | None, inputs: CalibrationInputs, options: CalibrateOptions, page: Path | None
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
    options: CalibrateOptions,
    people: PeopleOptions,
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
        result = _from_earlier(recording, inputs.earlier, inputs, options, people)
    else:
        result = run(
            recording, inputs.board, intrinsics=inputs.intrinsics, keypoints=inputs.keypoints,
            timestamps=inputs.timestamps, options=None if options == CalibrateOptions() else options,
            people=None if people == PeopleOptions() else people, progress=Bars(),
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
    recording: Path, earlier: Path, inputs: CalibrationInputs, options: CalibrateOptions, people: PeopleOptions
) -> BoardCalibration | PeopleCalibration:
    """Calibrate after cameras were moved."""
    from posefuse.pipeline.recalibrate import recalibrate

    if inputs.intrinsics is not None:
        raise CalibrationError("The lenses are those of the earlier calibration: remove `intrinsics`.")
    return recalibrate(
        recording, inputs.board, earlier, keypoints=inputs.keypoints, timestamps=inputs.timestamps,
        options=None if options == CalibrateOptions() else options,
        people=None if people == PeopleOptions() else people, progress=Bars(),
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
