"""``posefuse calibrate``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter

from posefuse.calibration.boards.calibration import BoardCalibration, CameraReport
from posefuse.cli.console import Bars, count, note, say, table
from posefuse.cli.help import OPTIONS_GROUP
from posefuse.cli.types import Overwrite, TimestampsPath
from posefuse.errors import FileError, choices
from posefuse.model.options.calibration import CalibrateOptions


def calibrate(
    images: Annotated[Path, Parameter(help="Folder with one video, or one folder of pictures, per camera.")],
    *,
    board: Annotated[
        str,
        Parameter(
            help="Board, such as charuco:7x5,square=30mm,marker=0.75,dict=4X4_50 or checkerboard:4x7,square=60mm "
            "(inner corners), or its file: TOML of posefuse, Caliscope or Anipose."
        ),
    ],
    output: Annotated[
        Path, Parameter(name=["--output", "-o"], help="Calibration file to write, in Anipose's format (name.toml).")
    ],
    intrinsics: Annotated[
        Path | None, Parameter(help="Calibration file with known lenses; lenses that it lacks are estimated.")
    ] = None,
    timestamps: TimestampsPath = None,
    overwrite: Overwrite = False,
    options: Annotated[
        CalibrateOptions, Parameter(name="*", group=Group(OPTIONS_GROUP, sort_key=2))
    ] = CalibrateOptions(),  # noqa: B008
) -> None:
    """Calibrate cameras from videos or pictures of a board that they see together.

    Estimates lenses, poses and time offsets with standard deviations, and states what to film next.
    """
    from posefuse.io.calibration.anipose import FORMAT, write
    from posefuse.io.outputs import check_new_files
    from posefuse.pipeline.calibrate import calibrate as run

    if not output.name.endswith(FORMAT.file_endings):
        raise FileError(f"{output}: the name of the calibration must end in {choices(FORMAT.file_endings)}.")
    check_new_files([output], overwrite=overwrite)
    result = run(images, board, intrinsics=intrinsics, timestamps=timestamps, options=options, progress=Bars())
    describe(result)
    write(result.rig, output)
    note(f"Wrote {output} in the format {FORMAT.name}")


def describe(result: BoardCalibration) -> None:
    """Print the accuracy of a calibration and what to film next."""
    say(
        f"{count(len(result.cameras), 'camera')}, {count(result.n_corners, 'corner')} in "
        f"{count(result.n_frames, 'frame')} of the board {result.board}"
    )
    distances = result.distances
    say(
        f"root mean square error {result.error_px:.2f} px; distances on the board {100 * distances.error:+.2f} % "
        f"(spread {100 * distances.spread:.2f} %)"
    )
    columns = ["camera", "images", "error px", "focal px", "lens", "rotation +- deg", "center +- mm", "offset ms"]
    rows = [_row(result, v, camera) for v, camera in enumerate(result.cameras)]
    table(None, columns, rows)
    note(f"+- is a standard deviation relative to camera {result.cameras[0].name!r}, in the worst direction.")
    for line in advice(result):
        note(line)


def _row(result: BoardCalibration, v: int, report: CameraReport) -> list[str]:
    camera = result.rig.cameras[v]
    focal = f"{camera.matrix[0, 0]:.0f}" + (f" +-{report.focal_sd_px:.1f}" if report.focal_sd_px > 0 else "")
    is_reference = v == 0
    offset = (
        "-"
        if is_reference or report.offset_sd_s != report.offset_sd_s
        else (f"{1000 * report.offset_s:.1f} +-{1000 * report.offset_sd_s:.1f}")
    )
    return [
        camera.name,
        str(report.n_images),
        f"{report.error_px:.2f}",
        focal,
        "given" if report.lens_given else camera.lens.value,
        "-" if is_reference else f"{report.rotation_sd_deg:.3f}",
        "-" if is_reference else f"{1000 * report.center_sd_m:.1f}",
        offset,
    ]


def advice(result: BoardCalibration) -> list[str]:
    """Return what to film next: image regions without the board where the lens was estimated, and weak pairs."""
    lines = []
    for report in result.cameras:
        missing = [] if report.lens_given else _missing_regions(report)
        if missing:
            lines.append(f"No board in the {', '.join(missing)} of camera {report.name!r}: film it there.")
    for v, report in enumerate(result.cameras):
        partners = [int(n) for u, n in enumerate(result.shared[v]) if u != v]
        if partners and max(partners) < 10:
            lines.append(
                f"Camera {report.name!r} shares only {max(partners)} frames with any other camera: film the board "
                "where both see it."
            )
    return lines


def _missing_regions(report: CameraReport) -> list[str]:
    """Return the ninths of the image in which no corner was found."""
    rows, columns = report.covered.shape
    vertical, horizontal = ("upper", "middle", "lower"), ("left", "center", "right")
    missing = []
    for r, high in enumerate(vertical):
        for c, side in enumerate(horizontal):
            part = report.covered[r * rows // 3 : (r + 1) * rows // 3, c * columns // 3 : (c + 1) * columns // 3]
            if not part.any():
                missing.append(f"{high} {side}")
    return missing
