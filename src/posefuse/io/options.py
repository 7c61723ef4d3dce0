"""Read and write options as TOML: the same record as the command line's flags, one table per stage."""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import tomli_w

from posefuse.arguments import checked
from posefuse.errors import OptionsError
from posefuse.io.files import must_exist, read_toml
from posefuse.model.noise import NoiseModel
from posefuse.model.options.aliases import suggest_option, with_current_names
from posefuse.model.options.bounds import field_hints, without_none
from posefuse.model.options.options import Options
from posefuse.model.options.sync import SyncOptions

T = TypeVar("T")


@dataclass(frozen=True)
class ProjectPaths:
    """Inputs and output that a project file names; paths are relative to the file.

    Attributes:
        recording: Folder of the recording.
        output: Folder for the results.
        calibration: Calibration file.
        keypoints: File or folder of 2D keypoints.
        timestamps: File or folder of frame times.
        edits: File of edits to apply to the result.
    """

    recording: Path | None = None
    output: Path | None = None
    calibration: Path | None = None
    keypoints: Path | None = None
    timestamps: Path | None = None
    edits: Path | None = None


PROJECT_KEYS = tuple(field.name for field in dataclasses.fields(ProjectPaths))


@checked
def read_options(path: str | Path) -> Options:
    """Read options from a TOML file such as ``posefuse init`` writes.

    Raises:
        FileError: if the file does not exist or is not TOML.
        OptionsError: on unknown keys or invalid values; one message names them all.
    """
    return read_project(path)[0]


def read_project(path: str | Path) -> tuple[Options, ProjectPaths]:
    """Read options, and the inputs and output that the file names, from a TOML file.

    Raises:
        FileError: if the file does not exist or is not TOML.
        OptionsError: on unknown keys or invalid values; one message names them all.
    """
    path = must_exist(Path(path), "options file")
    data = read_toml(path)
    # Options of posefuse run, which writes them beside those that all commands share.
    data.pop("run", None)
    paths = {}
    for key in PROJECT_KEYS:
        if key in data:
            value = data.pop(key)
            if not (isinstance(value, str) and value):
                raise OptionsError(f"{path.name}: {key} must be a path, got {value!r}.")
            paths[key] = path.parent / value
    return options_from_dict(data, path.name), ProjectPaths(**paths)


def options_from_dict(data: Mapping[str, Any], source: str) -> Options:
    """Return the options in nested tables.

    Args:
        data: Tables of options; words of a name are joined by ``_`` or ``-``.
        source: Name of the tables' origin, for messages.

    Raises:
        OptionsError: on unknown keys or invalid values; one message names them all.
    """
    return record_from_dict(Options, data, source)


def record_from_dict(kind: type[T], data: Mapping[str, Any], source: str) -> T:
    """Return the record of options in nested tables; arguments and errors as of :func:`options_from_dict`."""
    problems: list[str] = []
    record = _record(kind, data, "", problems)
    if problems:
        raise OptionsError("\n".join(f"{source}: {problem}" for problem in problems))
    assert record is not None
    return record


def stored_options(data: Mapping[str, Any], source: str) -> Options:
    """Return the options of a stored result, which may use former option names.

    Args:
        data: Tables of options.
        source: Name of the result, for messages.

    Raises:
        OptionsError: on unknown keys or invalid values.
    """
    return options_from_dict(with_current_names(data), source)


def options_to_toml(options: Options) -> str:
    """Return options as TOML; options without a value are left out."""
    return tomli_w.dumps(_without_none(dataclasses.asdict(options)))


def noise_to_toml(noise: NoiseModel, cameras: tuple[str, ...]) -> str:
    """Return the options that make a reconstruction use a measured noise, as TOML.

    Args:
        noise: Noise model with a scale for every camera.
        cameras: Names of the cameras, in the order of the scales.
    """
    rounded = [float(f"{scale:.4g}") for scale in noise.scale_px]
    tables = {
        "triangulation": {"confidence_exponent": round(noise.exponent, 3)},
        "noise": {
            "cameras": list(cameras),
            "scale_px": rounded,
            "spread": round(noise.spread, 3),
            **({"nu": round(noise.nu, 2)} if math.isfinite(noise.nu) else {}),
        },
    }
    return tomli_w.dumps(tables)


def read_sync(path: str | Path) -> SyncOptions:
    """Read the time offsets of views from a TOML file such as ``posefuse sync`` writes.

    Raises:
        FileError: if the file does not exist or is not TOML.
        OptionsError: if the file does not consist of one valid table ``[sync]``.
    """
    path = must_exist(Path(path), "sync file")
    data = read_toml(path)
    unknown = [key for key in data if key != "sync"]
    if unknown or "sync" not in data:
        found = f"unknown table {unknown[0]!r}" if unknown else "no table [sync]"
        raise OptionsError(f"{path.name}: {found}. A sync file contains exactly one table, [sync].")
    return options_from_dict(data, path.name).sync


def sync_to_toml(sync: SyncOptions) -> str:
    """Return the options that make a reconstruction correct time offsets, as TOML."""
    rounded = {
        "cameras": list(sync.cameras),
        "start_s": [round(value, 4) for value in sync.start_s],
        "offset_s": [round(value, 5) for value in sync.offset_s],
        "drift_ppm": [round(value, 1) for value in sync.drift_ppm],
    }
    return tomli_w.dumps({"sync": rounded})


def _record(kind: type[T], data: Mapping[str, Any], prefix: str, problems: list[str]) -> T | None:
    """Return the record of a table, or None if it has problems, which are appended to the list."""
    hints, values, before = field_hints(kind), {}, len(problems)
    for key, value in data.items():
        name = key.replace("-", "_")
        if name not in hints:
            siblings = [*hints, *PROJECT_KEYS] if not prefix else list(hints)
            problems.append(f"unknown option {prefix + key!r}. {suggest_option(f'{prefix}{name}', siblings)}")
            continue
        inner = without_none(hints[name])
        if not dataclasses.is_dataclass(inner):
            values[name] = value
        elif isinstance(value, Mapping):
            values[name] = _record(inner, value, f"{prefix}{name}.", problems)  # type: ignore[arg-type]
        else:
            problems.append(f"{prefix}{name} must be a table of options, got {value!r}.")
    tables = {name: value for name, value in values.items() if value is not None}
    try:
        record = kind(**tables)
    except OptionsError as error:
        problems.append(str(error))
        return None
    return record if len(problems) == before else None


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return list(value) if isinstance(value, tuple) else value
