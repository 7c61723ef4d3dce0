"""``posefuse edit``."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, wrote
from posefuse.errors import EditError
from posefuse.io.edits import read_edits
from posefuse.model.edits import Edit
from posefuse.model.reconstruction import Reconstruction


@dataclass(frozen=True)
class Done:
    """Edits as they were read.

    Attributes:
        edits: in their order.
        digests: the file's name to the SHA-256 of its content.
    """

    edits: tuple[Edit, ...]
    digests: Mapping[str, str]

    @classmethod
    def read(cls, path: Path) -> "Done":
        """Read a file of edits."""
        from posefuse.cli.reading import digest

        return cls(read_edits(path), {path.name: digest(path)})


def edit(
    result: Annotated[Path, Parameter(help="A result's folder, or its reconstruction.nc.")],
    edits: Annotated[Path, Parameter(help="TOML file of edits: a table [[edit]] for each.")],
    *,
    output: Annotated[
        Path | None,
        Parameter(name=["--output", "-o"], help="Folder for the edited result; by default <result>_edited beside it."),
    ] = None,
) -> None:
    """Merge, split, rename, drop or swap people of a result, and write it anew; the result itself stays.

    Each edit is a table [[edit]] with do = "merge" (person, into), "split" (person, into, from_frame), "rename"
    (person, to), "drop" (person, from_frame, to_frame) or "swap" (people, from_frame). posefuse reconstruct --edits
    does them again when it is run again.
    """
    from posefuse.cli.reconstruct import write_beside
    from posefuse.cli.results import open_result
    from posefuse.io.files import replacing_folder
    from posefuse.io.results import netcdf

    done = Done.read(edits)
    path, before = open_result(result)
    source = path.parent.resolve()
    output = output or source.with_name(f"{source.name}_edited")
    if output.resolve() == source:
        raise EditError(f"--output {output} is the result itself. Give another folder: the original is kept.")
    with replacing_folder(output) as staging:
        write_edited(before, done, staging / "reconstruction.nc")
        after = netcdf.read_reconstruction(staging / "reconstruction.nc")
        files, layer = write_beside(after, staging, Bars())
    wrote(["reconstruction.nc", *files], output, f"TRC and C3D hold the layer {layer}.")


def write_edited(before: Reconstruction, done: Done, path: Path) -> None:
    """Write a result with its edits done and named among its inputs."""
    from posefuse.editing import edited_chunks
    from posefuse.io.results import netcdf

    inputs = {**before.provenance.inputs, **done.digests}
    before = replace(before, provenance=replace(before.provenance, inputs=inputs))
    netcdf.write(edited_chunks(before, done.edits), path)
