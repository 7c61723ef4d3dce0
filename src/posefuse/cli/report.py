"""``posefuse report``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, note
from posefuse.cli.types import Overwrite, PointsUnit, Result


def report(
    result: Result,
    *,
    truth: Annotated[
        tuple[Path, ...],
        Parameter(help="Ground truth to compare with, as in posefuse evaluate: one file, or one file per person."),
    ] = (),
    length_unit: PointsUnit = None,
    output: Annotated[
        Path | None, Parameter(name=["--output", "-o"], help="HTML file; by default report.html beside the result.")
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a result's report as one HTML page that needs no network."""
    from posefuse.alignment.apply import in_calibration_world
    from posefuse.io.files import replacing
    from posefuse.io.outputs import check_new_files
    from posefuse.io.results.comparable import pair_with_truth, truth_at_frames_of
    from posefuse.io.results.open_result import open_result
    from posefuse.pipeline.evaluate_files import score
    from posefuse.report.html import render_report

    path, reconstruction = open_result(result)
    target = output or path.parent / "report.html"
    check_new_files([target], overwrite=overwrite)
    truth_m = accuracy = None
    if truth:
        compared = in_calibration_world(reconstruction)
        paired = pair_with_truth(compared, truth, length_unit)
        truth_m, accuracy = truth_at_frames_of(compared, paired), score(compared, paired)
        if reconstruction.alignment is not None:
            truth_m = reconstruction.alignment.points(truth_m)
    with replacing(target) as temporary:
        temporary.write_text(render_report(reconstruction, truth_m, accuracy, Bars()), "utf-8")
    note(f"Wrote {target}")
