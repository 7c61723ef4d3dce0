"""The project file of a run, ``posefuse.toml``: every choice that was made, as one file of options.

The table ``[run]`` holds the options of the run; everything else is the options of the reconstruction, which other
commands read as well. Paths in ``[run]`` are relative to the folder of the recording, so that the file can be used
with a copy of the folder.
"""

import dataclasses
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tomli_w

from posefuse.arguments import checked
from posefuse.errors import OptionsError
from posefuse.io.files import must_exist, read_toml
from posefuse.io.options import PROJECT_KEYS, options_from_dict, record_from_dict
from posefuse.model.options.options import Options
from posefuse.model.options.run import RunOptions

PROJECT_FILE = "posefuse.toml"
RUN_TABLE = "run"


def project_to_toml(run: RunOptions, options: Options) -> str:
    """Return the project file of a run; options without a value are left out."""
    header = (
        f"# Written by posefuse {version('posefuse')}: every choice of a run. The same result from the same files:\n"
        f"# posefuse run FOLDER --options {PROJECT_FILE} --output OUT\n\n"
    )
    return header + tomli_w.dumps({**_values(options), RUN_TABLE: _values(run)})


@checked
def read_run(path: str | Path) -> tuple[RunOptions, Options]:
    """Read the options of a run and of its reconstruction from ``posefuse.toml`` or another file of options.

    Raises:
        FileError: if the file does not exist or is not TOML.
        OptionsError: on unknown keys or invalid values; one message names them all.
    """
    path = must_exist(Path(path), "project file")
    data = read_toml(path)
    table = data.pop(RUN_TABLE, {})
    if not isinstance(table, dict):
        raise OptionsError(f"{path.name}: {RUN_TABLE} must be a table of options, got {table!r}.")
    for key in PROJECT_KEYS:
        data.pop(key, None)
    return record_from_dict(RunOptions, table, f"{path.name}: {RUN_TABLE}"), options_from_dict(data, path.name)


def _values(record: Any) -> dict[str, Any]:
    """Return the fields of a record that are set, as TOML values."""
    found: dict[str, Any] = {}
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        if not field.init or value is None:
            continue
        if dataclasses.is_dataclass(value):
            found[field.name] = _values(value)
        else:
            found[field.name] = list(value) if isinstance(value, tuple) else value
    return found
