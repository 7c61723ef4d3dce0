"""Write the arguments and options that messages name as flags of the command line.

Outside this package, messages name arguments as Python does, in backticks: `` `rate_hz` ``, `` `pick='largest'` ``, and
functions with their module: `` `posefuse.measure_sync` ``.
"""

import ast
import re
import shlex
from typing import Any

_NAMED = re.compile(r"(?<!`)`([a-z][a-z0-9_.]*)(?:=([^`]*))?`(?!`)")

COMMANDS = {
    "posefuse.calibrate_noise": "posefuse calibrate-noise",
    "posefuse.inspect_health": "posefuse inspect RECORDING --deep",
    "posefuse.measure_sync": "posefuse sync",
    "posefuse.refine_calibration": "posefuse refine-calibration",
}
"""Public functions that messages name, and their commands."""

FLAGS = {"format": "--to", "path": "--output", "rigid=True": "--from board", "videos": "--video"}
"""Arguments whose flag has another name."""


def as_flags(text: str) -> str:
    """Return a message with flags and commands in place of the arguments and functions in backticks."""
    return _NAMED.sub(_flag, text)


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
