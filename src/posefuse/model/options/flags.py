"""Write the arguments and options that messages name as flags of the command line.

Messages name arguments as Python does, in backticks: `` `rate_hz` ``, `` `pick='largest'` ``, and
functions with their module: `` `posefuse.measure_sync` ``.
"""

import ast
import re
import shlex
from collections.abc import Callable
from functools import cache
from typing import Any

_OPTION = re.compile(
    r"(?<![\w`'\"./=-])[a-z][a-z0-9]*(?:[._][a-z0-9]+)+(?![\w`'\"./=(])|(?:^|(?<=[.] ))[a-z][a-z0-9]*(?= must )"
)
_OF_FILE = re.compile(r"[^:]+\.toml: ")
_QUOTED = r"""(?<!\w)(?:'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*")(?!\w)"""
"""A name of the user's, whatever it contains."""
_NAMED = re.compile(_QUOTED + r"|(?<!`)`([a-z][a-z0-9_.]*)(?:=([^`]*))?`(?!`)")

COMMANDS = {
    "posefuse.calibrate_noise": "posefuse calibrate-noise",
    "posefuse.inspect_health": "posefuse inspect RECORDING --deep",
    "posefuse.measure_sync": "posefuse sync",
    "posefuse.refine_calibration": "posefuse refine-calibration",
}
"""Public functions that messages name, and their commands."""

FLAGS = {"format": "--to", "path": "--output", "rigid=True": "--from board", "videos": "--video"}
"""Arguments whose flag has another name."""


def options_as_flags(text: str) -> str:
    """Return the message of an invalid option with flags in place of the names of options, which are not in backticks.

    Names with a dot or an underscore are options wherever they occur, others at the start of a sentence. A message on a
    TOML file names options as the file does.
    """
    if _OF_FILE.match(text):
        return text
    return _OPTION.sub(
        lambda found: f"--{found[0].replace('_', '-')}" if found[0] in _option_names() else found[0], text
    )


@cache
def _option_names() -> frozenset[str]:
    """Return the names of all options, with and without their tables."""
    # Imported here, because every command imports this module, and the records load NumPy.
    from posefuse.model.options.calibration import CalibrateOptions, PeopleOptions
    from posefuse.model.options.catalog import list_options
    from posefuse.model.options.options import Options
    from posefuse.model.options.refinement import RefineOptions
    from posefuse.model.options.run import RunOptions
    from posefuse.model.options.stream import StreamOptions

    records = (Options, CalibrateOptions, PeopleOptions, RefineOptions, RunOptions, StreamOptions)
    names = {entry.name for record in records for entry in list_options(record)}
    return frozenset(names | {name.rpartition(".")[2] for name in names if "_" in name.rpartition(".")[2]})


def as_flags(text: str, mark: Callable[[str], str] = str) -> str:
    """Return a message with flags and commands in place of the arguments and functions in backticks.

    Args:
        text: a message.
        mark: returns each flag or command as it is shown.
    """
    return _NAMED.sub(lambda found: found[0] if found[1] is None else mark(_flag(found)), text)


def _flag(found: re.Match[str]) -> str:
    name, value = found[1], found[2]
    if name in COMMANDS:
        return COMMANDS[name]
    if value is None:
        return FLAGS.get(name, f"--{name.replace('_', '-')}")
    whole = FLAGS.get(f"{name}={value}")
    if whole is not None:
        return whole
    flag = FLAGS.get(name, f"--{name.replace('_', '-')}")
    words = _words(value)
    return " ".join([flag, *words])


def _words(value: str) -> list[str]:
    """Return a Python value as words of a command line; a switch that is on has none."""
    try:
        parsed: Any = ast.literal_eval(value)
    except (SyntaxError, ValueError):
        return re.sub(r"[\[\](){},'\"]", " ", value).split()
    if parsed is True:
        return []
    if isinstance(parsed, dict):
        return [shlex.quote(f"{key}={item}") for key, item in parsed.items()]
    items = parsed if isinstance(parsed, list | tuple) else [parsed]
    return [shlex.quote(str(item)) for item in items]
