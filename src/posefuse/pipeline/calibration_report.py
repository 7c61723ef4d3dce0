"""Write the report of a calibration."""

from pathlib import Path

from posefuse.arguments import checked
from posefuse.calibration.boards.calibration import BoardCalibration
from posefuse.calibration.boards.summary import summarize_board
from posefuse.calibration.people.result import PeopleCalibration
from posefuse.calibration.people.summary import summarize_people
from posefuse.calibration.scene.calibration import SceneCalibration
from posefuse.calibration.scene.summary import summarize_scene
from posefuse.io.files import replacing
from posefuse.model.calibration_summary import CalibrationSummary
from posefuse.report.calibration.page import render_calibration


@checked
def write_calibration_report(
    calibration: BoardCalibration | PeopleCalibration | SceneCalibration | CalibrationSummary, path: str | Path
) -> None:
    """Write the report of a calibration as one HTML file that needs no network.

    Args:
        calibration: result of :func:`posefuse.calibrate` or :func:`posefuse.calibrate_scene`, or the summary of a
            calibration.
        path: file to write; it is replaced if it exists.
    """
    with replacing(Path(path)) as temporary:
        temporary.write_text(render_calibration(_summary(calibration)), "utf-8")


def _summary(
    calibration: BoardCalibration | PeopleCalibration | SceneCalibration | CalibrationSummary,
) -> CalibrationSummary:
    if isinstance(calibration, BoardCalibration):
        return summarize_board(calibration)
    if isinstance(calibration, SceneCalibration):
        return summarize_scene(calibration)
    return summarize_people(calibration) if isinstance(calibration, PeopleCalibration) else calibration
