"""What ``posefuse calibrate`` prints of the verdict on a calibration."""

from posefuse.cli.console import note
from posefuse.model.calibration_summary import CalibrationSummary


def describe_assessment(summary: CalibrationSummary) -> None:
    """Print the verdict on a calibration, and what to film or change."""
    from posefuse.calibration.assessment import assess

    assessment = assess(summary)
    note(assessment.sentence)
    for each in assessment.advice:
        note(str(each))
