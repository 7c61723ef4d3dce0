"""``posefuse report``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, note
from posefuse.cli.types import Result


def report(
    result: Result,
    *,
    truth: Annotated[Path | None, Parameter(help="Ground truth to compare with, such as a truth.nc.")] = None,
    output: Annotated[
        Path | None, Parameter(name=["--output", "-o"], help="HTML file; by default report.html beside the result.")
    ] = None,
) -> None:
    """Write a result's report as one HTML page that needs no network."""
    from posefuse.alignment.apply import in_calibration_world, in_world_of
    from posefuse.cli.evaluate import compare
    from posefuse.io.files import must_exist, replacing
    from posefuse.io.results import netcdf
    from posefuse.io.results.open_result import open_result
    from posefuse.report.html import render_report

    path, reconstruction = open_result(result)
    target = output or path.parent / "report.html"
    known = accuracy = None
    if truth is not None:
        known = in_world_of(reconstruction, netcdf.read_reconstruction(must_exist(truth, "truth")))
        accuracy = compare(in_calibration_world(reconstruction), (truth,))
    with replacing(target) as temporary:
        temporary.write_text(render_report(reconstruction, known, accuracy, Bars()), "utf-8")
    note(f"Wrote {target}")
