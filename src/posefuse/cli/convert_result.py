"""``posefuse convert`` of a stored result."""

from dataclasses import replace
from pathlib import Path

from posefuse.cli.console import note, wrote
from posefuse.model.options.options import LayerName


def convert_result(path: Path, to: str | None, output: Path, layer: LayerName | None = None) -> None:
    """Write a stored result in another format, and say what of it the format does not hold.

    Args:
        path: a result's folder, or its reconstruction.nc.
        to: name of a format that ``posefuse formats`` lists as written; by default by the output's name.
        output: the file, or the folder of formats that are one; with several people and formats of one person
            ``<stem>_<person><suffix>`` each.
        layer: which layer, by default the best present.

    Raises:
        FileError: if there is no such result, or the output cannot be written.
        ResultError: if there is no such format or layer, or the format cannot hold the result.
    """
    from posefuse.errors import ResultError
    from posefuse.io.results.open_result import open_result
    from posefuse.io.results.write import write

    source, result = open_result(path)
    if output.resolve() == source.resolve():
        raise ResultError(f"--output {output} is the result itself. Give another place: the original is kept.")
    result = replace(result, options=replace(result.options, layer=layer or result.options.layer))
    done = write(result, output, to)
    wrote([file.name for file in done.files], output.parent)
    for remark in done.notes:
        note(f"note: {remark}")
