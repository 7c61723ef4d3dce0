"""Output of ``posefuse calibrate --scene-points``."""

from posefuse.calibration.scene.calibration import SceneCalibration
from posefuse.cli.assessment import describe_assessment
from posefuse.cli.console import count, note, say, table


def describe_scene(result: SceneCalibration) -> None:
    """Print the accuracy of a calibration by points of known position, and what to measure again."""
    from posefuse.calibration.scene.summary import summarize_scene

    places = sum(report.n_points for report in result.cameras)
    say(
        f"{count(len(result.cameras), 'camera')}, {places} places of points of known position: root mean square error "
        f"{result.error_px:.2f} px"
    )
    rows = [
        [
            report.name,
            str(report.n_points),
            f"{report.error_px:.2f}",
            f"{camera.matrix[0, 0]:.0f}",
            "given" if report.lens_given else camera.lens.value,
            f"{report.rotation_sd_deg:.2f}",
            f"{1000 * report.center_sd_m:.0f}",
        ]
        for camera, report in zip(result.rig.cameras, result.cameras, strict=True)
    ]
    table(None, ["camera", "points", "error px", "focal px", "lens", "+- deg", "+- mm"], rows)
    note(
        "+- is a standard deviation in the world of the points, in the worst direction, for places measured to "
        f"{result.sd_px:.1f} px."
    )
    describe_assessment(summarize_scene(result))
