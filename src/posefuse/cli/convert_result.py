"""``posefuse convert`` of a stored result, and the formats that commands write as well."""

from collections.abc import Sequence
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
    from posefuse.cli.results import open_result
    from posefuse.errors import ResultError
    from posefuse.io.results.write import write

    source, result = open_result(path)
    if output.resolve() == source.resolve():
        raise ResultError(f"--output {output} is the result itself. Give another place: the original is kept.")
    result = replace(result, options=replace(result.options, layer=layer or result.options.layer))
    done = write(result, output, to)
    wrote([file.name for file in done.files], output.parent)
    for remark in done.notes:
        note(f"note: {remark}")


def must_be_written(also: Sequence[str]) -> None:
    """Refuse unknown names before any work is done.

    Raises:
        OptionsError: if one is of no format that is written beside a result.
    """
    from posefuse.errors import OptionsError, suggestion
    from posefuse.io.results.write import additional_names

    offered = additional_names() if also else {}
    for name in also:
        if name not in offered:
            raise OptionsError(f"--also {name}: no such format beside a result. {suggestion(name, offered)}")


def also_into(folder: Path, also: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Write the result of a folder in other formats beside it.

    Returns:
        The names of what was written, and what it does not hold.
    """
    if not also:
        return [], ()
    from posefuse.cli.results import open_result
    from posefuse.io.results.write import write_also

    return write_also(open_result(folder)[1], folder, also)
