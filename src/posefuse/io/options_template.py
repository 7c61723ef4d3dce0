"""Write the TOML files of ``posefuse init``: a short project file, or a file of every option."""

import textwrap
from collections.abc import Iterator

import tomli_w

from posefuse.model.options.bounds import valid_choices
from posefuse.model.options.catalog import OptionEntry, list_options

_HEADER = """\
# Project file of posefuse. Run it with: posefuse reconstruct --options FILE
# Flags on the command line override this file. Paths are relative to this file.
# Remove the # before an option to set it.
"""

_PATHS = """
# Folder of the recording: calibration and 2D keypoints.
recording = "."

# Folder for the results.
output = "out"

# Calibration file, if the recording's folder has none or several.
# calibration = "calibration.toml"

# File or folder of 2D keypoints, if the recording's folder has none or several.
# keypoints = "pose"
"""


def project_template() -> str:
    """Return a project file with inputs, output and the common options."""
    return _HEADER + _PATHS + "\n" + "\n".join(_lines(common=True)) + "\n"


def options_template() -> str:
    """Return a file of every option at its default; options without a default are commented out."""
    header = [
        "# Options of posefuse. Use this file with: posefuse reconstruct --options FILE RECORDING -o OUTPUT",
        "# Flags on the command line override this file.",
        "",
    ]
    return "\n".join([*header, *_lines(common=False)]) + "\n"


def _lines(*, common: bool) -> Iterator[str]:
    table = ""
    for entry in list_options():
        if common and not entry.bounds.common:
            continue
        if entry.table != table:
            table = entry.table
            yield f"[{table}]"
        yield from textwrap.wrap(
            f"{entry.text} Valid: {entry.expected}.",
            100,
            initial_indent="# ",
            subsequent_indent="# ",
            break_on_hyphens=False,
        )
        if entry.is_unset:
            yield f"# {entry.key} = {_example(entry)}"
        else:
            yield tomli_w.dumps({entry.key: entry.default}).strip()
        yield ""


def _example(entry: OptionEntry) -> str:
    """Return a valid value of an option that has no default, as TOML."""
    if entry.bounds.example is not None:
        return entry.bounds.example
    allowed = valid_choices(entry.hint, entry.bounds)
    if not allowed:
        raise ValueError(f"{entry.name} has neither a default nor choices: declare an example.")
    return f'["{allowed[0]}"]' if entry.default == () else f'"{allowed[0]}"'
