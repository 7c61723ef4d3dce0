"""``posefuse edit``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, note, wrote
from posefuse.cli.describe_result import describe_result, layer_remark
from posefuse.cli.types import Overwrite


def edit(
    result: Annotated[Path, Parameter(help="Folder of a result or of a run, or reconstruction.nc.")],
    edits: Annotated[Path, Parameter(help="TOML file of edits: one table [[edit]] per edit.")],
    *,
    output: Annotated[
        Path | None,
        Parameter(name=["--output", "-o"], help="Folder for the edited result; by default <result>_edited beside it."),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Merge, split, rename, drop or swap people of a result, and write an edited copy.

    Each edit is a table [[edit]] with do = "merge" (person, into), "split" (person, into, from_frame), "rename"
    (person, to), "drop" (person, from_frame, to_frame) or "swap" (people, from_frame). posefuse reconstruct --edits
    applies them whenever the recording is reconstructed.
    """
    from posefuse.io.results.open_result import open_result
    from posefuse.pipeline.edit_result import edit_result

    output, written = edit_result(result, edits, output, overwrite=overwrite, progress=Bars())
    describe_result(open_result(output)[1])
    for remark in written.remarks:
        note(f"note: {remark}")
    files = ["reconstruction.nc", *written.files]
    wrote(files, output, layer_remark(files, written.layer))
