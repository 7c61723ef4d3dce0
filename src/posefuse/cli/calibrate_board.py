"""What ``posefuse calibrate`` prints of a calibration by a board."""

from posefuse.calibration.boards.calibration import BoardCalibration, CameraReport
from posefuse.cli.assessment import describe_assessment
from posefuse.cli.console import count, note, say, table


def describe_board(result: BoardCalibration) -> None:
    """Print the accuracy of a calibration and what to film next."""
    from posefuse.calibration.boards.summary import summarize_board

    say(
        f"{count(len(result.cameras), 'camera')}, {count(result.n_corners, 'corner')} in "
        f"{count(result.n_frames, 'frame')} of the board {result.board}"
    )
    distances = result.distances
    say(
        f"root mean square error {result.error_px:.2f} px; distances on the board {100 * distances.error:+.2f} % "
        f"(spread {100 * distances.spread:.2f} %)"
    )
    if result.held_out.n_frames:
        say(
            f"in {count(result.held_out.n_frames, 'frame')} held out of the calibration: root mean square error "
            f"{result.held_out.rms_px:.2f} px, median {result.held_out.median_px:.2f} px"
        )
    columns = ["camera", "images", "error px", "held out", "focal px", "lens", "+- deg", "+- mm", "offset ms"]
    rows = [_row(result, v, camera) for v, camera in enumerate(result.cameras)]
    table(None, columns, rows)
    note(
        f"+- is a standard deviation relative to camera {result.cameras[0].name!r}, in the worst direction; errors are "
        "root mean squares in px."
    )
    for line in result.notes:
        note(line)
    describe_assessment(summarize_board(result))


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
        f"{report.held_out_px:.2f}" if report.held_out_px == report.held_out_px else "-",
        focal,
        "given" if report.lens_given else camera.lens.value,
        "-" if is_reference else f"{report.rotation_sd_deg:.3f}",
        "-" if is_reference else f"{1000 * report.center_sd_m:.1f}",
        offset,
    ]
