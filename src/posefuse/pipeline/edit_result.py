"""Edit the people of a stored result."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from posefuse.editing import edited_chunks
from posefuse.errors import EditError
from posefuse.io.edits import read_edits
from posefuse.io.files import RESULT_FILES, replacing_folder
from posefuse.io.open_recording import digest_path
from posefuse.io.outputs import check_new_folder
from posefuse.io.results import netcdf
from posefuse.io.results.open_result import open_result
from posefuse.model.edits import Edit
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.write_outputs import WrittenOutputs, write_outputs
from posefuse.progress import Progress, Silent


@dataclass(frozen=True)
class Edits:
    """Edits read from a file.

    Attributes:
        edits: edits in the order in which they are applied.
        digests: name of the file to the SHA-256 of its content.
    """

    edits: tuple[Edit, ...]
    digests: Mapping[str, str]

    @classmethod
    def read(cls, path: Path) -> "Edits":
        """Read a file of edits."""
        return cls(read_edits(path), {path.name: digest_path(path)})


def edit_result(
    result: Path,
    edits: Path,
    output: Path | None = None,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> tuple[Path, WrittenOutputs]:
    """Apply edits to a stored result and write the edited result to another folder.

    Args:
        result: folder of a result, or its ``reconstruction.nc``.
        edits: TOML file of edits.
        output: folder for the edited result, by default ``<result>_edited`` beside the result.
        overwrite: whether to replace an earlier result in the folder.
        progress: receives the progress.

    Returns:
        The output folder and what was written beside ``reconstruction.nc``.

    Raises:
        EditError: if the edits do not fit the result, or the output is the result itself.
        OutputExistsError: if the output contains an earlier result and ``overwrite`` is False.
    """
    loaded = Edits.read(edits)
    path, before = open_result(result)
    source = path.parent.resolve()
    output = output or source.with_name(f"{source.name}_edited")
    if output.resolve() == source:
        raise EditError(f"`output={str(output)!r}` is the result itself. Choose another folder; the original is kept.")
    check_new_folder(output, overwrite=overwrite, marker=RESULT_FILES[0])
    with replacing_folder(output) as staging:
        write_edited(before, loaded, staging / "reconstruction.nc")
        after = netcdf.read_reconstruction(staging / "reconstruction.nc")
        written = write_outputs(after, staging, progress or Silent(), output.resolve().name)
    return output, written


def write_edited(before: Reconstruction, edits: Edits, path: Path) -> None:
    """Write a result with edits applied; the file of edits is named among its inputs."""
    inputs = {**before.provenance.inputs, **edits.digests}
    before = replace(before, provenance=replace(before.provenance, inputs=inputs))
    netcdf.write(edited_chunks(before, edits.edits), path)
