"""``posefuse convert`` for a stored result."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from posefuse.cli.console import note, wrote
from posefuse.model.options.options import LayerName, Options


def convert_result(
    path: Path,
    to: str | None,
    output: Path,
    layer: LayerName | None = None,
    change: Callable[[Options], Options] = lambda options: options,
    *,
    overwrite: bool = False,
) -> None:
    """Write a stored result in another format and print what the format cannot hold.

    Args:
        path: Folder of a result, or its reconstruction.nc.
        to: Name of a format that ``posefuse formats`` lists as written; by default by the output's name.
        output: Output file, or folder for formats of many files. Formats of one person write one file per person,
            ``<stem>_<person><suffix>``, if there are several people.
        layer: Layer to write; by default the best one available.
        change: Returns the options of the result with changes, such as of the session.
        overwrite: Whether to replace an existing output.

    Raises:
        FileError: if the result does not exist, or the output cannot be written.
        ResultError: if the format or layer does not exist, or the format cannot hold the result.
    """
    from posefuse.errors import ResultError
    from posefuse.io.results.open_result import open_result
    from posefuse.io.results.write import write

    source, result = open_result(path)
    if output.resolve() == source.resolve():
        raise ResultError(f"--output {output} is the result itself. Choose another output.")
    result = replace(result, options=replace(change(result.options), layer=layer or result.options.layer))
    done = write(result, output, to, overwrite=overwrite)
    wrote([file.name for file in done.files], output.parent)
    for remark in done.notes:
        note(f"note: {remark}")
