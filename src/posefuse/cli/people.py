"""``posefuse people``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, note
from posefuse.cli.types import Overwrite, Result
from posefuse.cli.videos import Offsets, Videos


def people(
    result: Result,
    *,
    video: Videos = (),
    offset_s: Offsets = (),
    output: Annotated[
        Path | None, Parameter(name=["--output", "-o"], help="HTML file; by default people.html beside the result.")
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a contact sheet: a picture of each person found, with the name to pass to --person."""
    from posefuse.cli.videos import offsets_by_camera, videos_by_camera
    from posefuse.io.results.open_result import open_result
    from posefuse.pipeline.contact_sheet import write_contact_sheet

    path, reconstruction = open_result(result)
    target = output or path.parent / "people.html"
    write_contact_sheet(
        reconstruction,
        target,
        videos=videos_by_camera(reconstruction.rig, video),
        offset_s=offsets_by_camera(offset_s),
        overwrite=overwrite,
        progress=Bars(),
    )
    note(f"Wrote {target}")
