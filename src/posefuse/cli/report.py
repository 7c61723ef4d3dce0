"""``posefuse report``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, count, note
from posefuse.cli.types import Overwrite, PointsUnit, Result
from posefuse.cli.videos import Offsets, Videos


def report(
    result: Result,
    *,
    truth: Annotated[
        tuple[Path, ...],
        Parameter(help="Ground truth to compare with, as in posefuse evaluate: one file, or one file per person."),
    ] = (),
    length_unit: PointsUnit = None,
    video: Videos = (),
    offset_s: Offsets = (),
    output: Annotated[
        Path | None, Parameter(name=["--output", "-o"], help="HTML file; by default report.html beside the result.")
    ] = None,
    name: Annotated[
        str, Parameter(help="Name of the recording in the title; by default that of the result's folder.")
    ] = "",
    overwrite: Overwrite = False,
) -> None:
    """Write a result's report as one HTML page that needs no network.

    Videos are shown beside the 3D scene with the skeleton on them, as small copies. Copies of more than 8 MB together
    are written to a folder beside the page.
    """
    from posefuse.alignment.apply import in_calibration_world
    from posefuse.cli.videos import offsets_by_camera, videos_by_camera
    from posefuse.io.outputs import check_new_page
    from posefuse.io.results.comparable import pair_with_truth, truth_at_frames_of
    from posefuse.io.results.open_result import open_result
    from posefuse.pipeline.evaluate_files import score
    from posefuse.pipeline.report_videos import ReportTruth, write_report

    path, reconstruction = open_result(result)
    target = output or path.parent / "report.html"
    check_new_page(target, overwrite=overwrite)
    known = None
    if truth:
        compared = in_calibration_world(reconstruction)
        paired = pair_with_truth(compared, truth, length_unit)
        truth_m, accuracy = truth_at_frames_of(compared, paired), score(compared, paired)
        if reconstruction.alignment is not None:
            truth_m = reconstruction.alignment.points(truth_m)
        known = ReportTruth(truth_m, accuracy)
    written = write_report(
        reconstruction,
        target,
        videos=videos_by_camera(reconstruction.rig, video),
        offset_s=offsets_by_camera(offset_s),
        truth=known,
        recording=name or (result if result.is_dir() else result.parent).resolve().name,
        overwrite=overwrite,
        progress=Bars(),
    )
    note(
        f"Wrote {target}" + (f", and {count(len(written) - 1, 'video')} in {written[1].parent}" if written[1:] else "")
    )
