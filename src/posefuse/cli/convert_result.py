"""``posefuse convert`` for a stored result, and the additional formats of ``--also``."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from posefuse.cli.console import note, wrote
from posefuse.model.options.options import LayerName


def convert_result(path: Path, to: str | None, output: Path, layer: LayerName | None = None) -> None:
    """Write a stored result in another format and print what the format cannot hold.

    Args:
        path: Folder of a result, or its reconstruction.nc.
        to: Name of a format that ``posefuse formats`` lists as written; by default by the output's name.
        output: Output file, or folder for formats of many files. Formats of one person write one file per person,
            ``<stem>_<person><suffix>``, if there are several people.
        layer: Layer to write; by default the best one available.

    Raises:
        FileError: if the result does not exist, or the output cannot be written.
        ResultError: if the format or layer does not exist, or the format cannot hold the result.
    """
    from posefuse.cli.results import open_result
    from posefuse.errors import ResultError
    from posefuse.io.results.write import write

    source, result = open_result(path)
    if output.resolve() == source.resolve():
        raise ResultError(f"--output {output} is the result itself. Choose another output.")
    result = replace(result, options=replace(result.options, layer=layer or result.options.layer))
    done = write(result, output, to)
    wrote([file.name for file in done.files], output.parent)
    for remark in done.notes:
        note(f"note: {remark}")


def must_be_written(also: Sequence[str]) -> None:
    """Check the names of additional formats before any work is done.

    Raises:
        OptionsError: if a name is not an additional format.
    """
    from posefuse.errors import OptionsError, suggestion
    from posefuse.io.results.write import additional_names

    offered = additional_names() if also else {}
    for name in also:
        if name not in offered:
            raise OptionsError(
                f"--also {name}: there is no additional format of this name. {suggestion(name, offered)}"
            )


def also_into(folder: Path, also: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Write the result in a folder in additional formats.

    Returns:
        Names of the written files, and notes on what they cannot hold.
    """
    if not also:
        return [], ()
    from posefuse.cli.results import open_result
    from posefuse.io.results.write import write_also

    return write_also(open_result(folder)[1], folder, also)
