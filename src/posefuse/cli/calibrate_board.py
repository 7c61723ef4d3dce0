"""What ``posefuse calibrate`` prints of a calibration by a board."""

from itertools import combinations

import numpy as np

from posefuse.calibration.boards.calibration import BoardCalibration, CameraReport
from posefuse.cli.assessment import describe_assessment
from posefuse.cli.console import count, note, table
from posefuse.model.cameras import CameraRig


def describe_board(result: BoardCalibration) -> None:
    """Print the accuracy of a calibration and what to film next."""
    from posefuse.calibration.boards.summary import summarize_board

    note(
        f"{count(len(result.cameras), 'camera')}, {count(result.n_corners, 'corner')} in "
        f"{count(result.n_frames, 'frame')} of the board {result.board}"
    )
    distances = result.distances
    note(
        f"root mean square error {result.error_px:.2f} px; distances on the board {100 * distances.error:+.2f} % "
        f"(spread {100 * distances.spread:.2f} %)"
    )
    if result.held_out.n_frames:
        note(
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
    for line in (*_camera_distances(result.rig), *result.notes):
        note(line)
    describe_assessment(summarize_board(result))


def _row(result: BoardCalibration, v: int, report: CameraReport) -> list[str]:
    camera = result.rig.cameras[v]
    focal = f"{camera.matrix[0, 0]:.0f}" + (f" +-{report.focal_sd_px:.2g}" if report.focal_sd_px > 0 else "")
    is_reference = v == 0
    offset = (
        "-"
        if is_reference or report.offset_sd_s != report.offset_sd_s
        else _offset(1000 * report.offset_s, 1000 * report.offset_sd_s)
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


def _offset(offset_ms: float, sd_ms: float) -> str:
    """Return a time offset with the digits that its standard deviation leaves, so that the table fits 80 columns."""
    digits = 0 if sd_ms >= 1.0 else 1
    return f"{offset_ms:.{digits}f} +-{sd_ms:.{digits}f}"


def _camera_distances(rig: CameraRig) -> list[str]:
    """Return the least and the largest distance of two cameras, which show a wrong size of the board."""
    centers, names = np.array([camera.center_m for camera in rig.cameras]), rig.names
    pairs = [(float(np.linalg.norm(centers[a] - centers[b])), a, b) for a, b in combinations(range(len(names)), 2)]
    if not pairs:
        return []
    chosen = dict.fromkeys((min(pairs), max(pairs)))
    words = [f"{distance_m:.3g} m from {names[a]!r} to {names[b]!r}" for distance_m, a, b in chosen]
    return [f"Distances between cameras: {', '.join(words)}. Measure one to check the size of the board."]
