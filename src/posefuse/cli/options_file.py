"""Options from a file, in the form that the command line's parser takes them."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from posefuse.io.files import read_toml
from posefuse.io.options import PROJECT_KEYS, read_project
from posefuse.io.project import RUN_TABLE, read_run

_PATHS_OF_COMMAND = {
    "reconstruct": PROJECT_KEYS,
    **dict.fromkeys(
        ("inspect", "compare", "sync", "calibrate-noise", "refine-calibration"),
        ("recording", "calibration", "keypoints", "timestamps"),
    ),
}
"""Paths of a project file that each command takes from it; other commands take only options."""


def command_values(path: Path, command: str | None, *, from_videos: bool = False) -> dict[str, Any]:
    """Return the values that a file sets, by flag name, without those that it leaves out.

    Args:
        path: TOML file.
        command: Name of the command that takes the values.
        from_videos: Whether it takes the table of a run.

    Raises:
        FileError: if the file does not exist or is not TOML.
        OptionsError: on unknown keys or invalid values.
    """
    options, paths = read_project(path)
    written = read_toml(path)
    for key in PROJECT_KEYS:
        written.pop(key, None)
    of_run = written.pop(RUN_TABLE, {})
    values = _set_values(dataclasses.asdict(options), written)
    # --sync FILE is a flag of its own beside the table.
    values |= {f"sync.{key}": value for key, value in values.pop("sync", {}).items()}
    if from_videos:
        values |= _set_values(dataclasses.asdict(read_run(path)[0]), of_run)
    for key in _PATHS_OF_COMMAND.get(command or "", ()):
        value = getattr(paths, key)
        if value is not None:
            values[key] = str(value)
    return values


def _set_values(checked: Mapping[str, Any], written: Mapping[str, Any]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for key, value in written.items():
        name = key.replace("-", "_")
        flag = name.replace("_", "-")
        values[flag] = _set_values(checked[name], value) if isinstance(value, dict) else checked[name]
        if isinstance(values[flag], tuple):
            values[flag] = list(values[flag])
    return values
