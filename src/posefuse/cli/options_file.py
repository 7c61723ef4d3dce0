"""Options from a file, in the shape the command line's parser takes them."""

import dataclasses
from pathlib import Path
from typing import Any

from posefuse.io.files import read_toml
from posefuse.io.options import read_options


def command_values(path: Path) -> dict[str, Any]:
    """The options that a file sets, checked, by flag name; what it leaves out is left out.

    Raises:
        FileError: if there is no such file, or it is not TOML.
        OptionsError: on an unknown key, or a value of the wrong kind.
    """
    return _set_values(dataclasses.asdict(read_options(path)), read_toml(path))


def _set_values(checked: dict[str, Any], written: dict[str, Any]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for key, value in written.items():
        name = key.replace("-", "_")
        flag = name.replace("_", "-")
        values[flag] = _set_values(checked[name], value) if isinstance(value, dict) else checked[name]
        if isinstance(values[flag], tuple):
            values[flag] = list(values[flag])
    return values
