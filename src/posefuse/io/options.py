"""Options as TOML: the same record as the command line's flags, one table a stage."""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec
import tomli_w
from docstring_parser import parse

from posefuse.errors import OptionsError, choices, suggestion
from posefuse.io.files import must_exist, read_toml
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.options.sync import SyncOptions

T = TypeVar("T")


def read_options(path: str | Path) -> Options:
    """Read options from a TOML file such as ``posefuse init`` writes.

    Raises:
        FileError: if there is no such file, or it is not TOML.
        OptionsError: on an unknown key, or a value of the wrong kind.
    """
    path = must_exist(Path(path), "options file")
    return options_from_dict(read_toml(path), path.name)


def options_from_dict(data: Mapping[str, Any], source: str) -> Options:
    """Options from nested tables.

    Raises:
        OptionsError: on an unknown key, or a value of the wrong kind.
    """
    return _record(Options, data, source, "")


def options_to_toml(options: Options) -> str:
    """Options as TOML; what is not set is left out."""
    return tomli_w.dumps(_without_none(dataclasses.asdict(options)))


def noise_to_toml(noise: NoiseModel, cameras: tuple[str, ...]) -> str:
    """The options that make a reconstruction use a noise found before, as TOML.

    Args:
        noise: with a scale for each camera.
        cameras: their names, in the same order.
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
    """How late views are, from a TOML file such as ``posefuse sync`` writes.

    Raises:
        FileError: if there is no such file, or it is not TOML.
        OptionsError: if it says anything else, or nothing.
    """
    path = must_exist(Path(path), "sync file")
    data = read_toml(path)
    unknown = [key for key in data if key != "sync"]
    if unknown or "sync" not in data:
        found = f"unknown table {unknown[0]!r}" if unknown else "no table [sync]"
        raise OptionsError(f"{path.name}: {found}. A sync file, as posefuse sync writes it, has one table, [sync].")
    return options_from_dict(data, path.name).sync


def sync_to_toml(sync: SyncOptions) -> str:
    """The options that make a reconstruction put views in step, as TOML."""
    rounded = {
        "cameras": list(sync.cameras),
        "start_s": [round(value, 4) for value in sync.start_s],
        "offset_s": [round(value, 5) for value in sync.offset_s],
        "drift_ppm": [round(value, 1) for value in sync.drift_ppm],
    }
    return tomli_w.dumps({"sync": rounded})


def options_template() -> str:
    """A TOML file of every option at its default, each with its explanation; unset ones are commented out."""
    lines = ["# Options of posefuse. Give this file with --options FILE; a flag on the command line beats it.", ""]
    lines += _template(Options, "")
    return "\n".join(lines) + "\n"


def _record(kind: type[T], data: Mapping[str, Any], source: str, prefix: str) -> T:
    hints = get_type_hints(kind)
    values: dict[str, Any] = {}
    for key, value in data.items():
        name = key.replace("-", "_")
        if name not in hints:
            raise OptionsError(f"{source}: unknown option {prefix}{key!r}. {suggestion(name, hints)}")
        if dataclasses.is_dataclass(hints[name]):
            if not isinstance(value, Mapping):
                raise OptionsError(f"{source}: {prefix}{key} is a table of options, got {value!r}.")
            values[name] = _record(hints[name], value, source, f"{prefix}{key}.")  # type: ignore[arg-type]
        else:
            values[name] = _leaf(hints[name], value, f"{source}: {prefix}{key}")
    try:
        return kind(**values)
    except OptionsError as error:
        raise OptionsError(f"{source}: {error}") from None


def _leaf(hint: Any, value: Any, where: str) -> Any:
    try:
        return msgspec.convert(value, hint)
    except msgspec.ValidationError as error:
        allowed = _literals(hint)
        expected = f"Choose one of: {choices(allowed)}." if allowed else f"{error}."
        raise OptionsError(f"{where}: cannot be {value!r}. {expected}") from None


def _literals(hint: Any) -> tuple[Any, ...]:
    if get_origin(hint) is Literal:
        return get_args(hint)
    return tuple(value for part in get_args(hint) for value in _literals(part))


def _template(kind: type, prefix: str) -> Iterator[str]:
    help_of = {parameter.arg_name: parameter.description for parameter in parse(kind.__doc__ or "").params}
    tables = []
    for field in dataclasses.fields(kind):
        hint = get_type_hints(kind)[field.name]
        if dataclasses.is_dataclass(hint):
            tables.append((field.name, hint))
            continue
        yield from _comment(help_of.get(field.name) or "")
        allowed = _literals(hint)
        if allowed:
            yield f"# One of: {choices(allowed)}."
        default = field.default
        if default is None or default == ():
            yield f"# {field.name} = {_example(field.name, hint, allowed)}"
        else:
            yield tomli_w.dumps({field.name: default}).strip()
        yield ""
    for name, hint in tables:
        yield f"[{prefix}{name}]"
        yield from _template(hint, f"{prefix}{name}.")


def _comment(text: str) -> Iterator[str]:
    words = " ".join(text.split())
    yield f"# {words[:1].upper()}{words[1:]}"


_EXAMPLES = {
    "volume_m": "[-3.0, -3.0, -0.5, 3.0, 3.0, 2.5]",
    "floor_points_m": "[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]",
    "origin_m": "[0.0, 0.0, 0.0]",
    "forward_m": "[1.0, 0.0, 0.0]",
    "length_between": '["left_knee", "left_ankle"]',
    "rate_hz": "60.0",
    "image_size": "[1920, 1080]",
}


def _example(name: str, hint: Any, allowed: tuple[Any, ...]) -> str:
    if name in _EXAMPLES:
        return _EXAMPLES[name]
    if allowed:
        return f'["{allowed[0]}"]' if get_origin(hint) is tuple else f'"{allowed[0]}"'
    kinds = get_args(hint)
    if float in kinds:
        if get_origin(hint) is tuple:
            return "[2.0, 2.5]"
        return "1.0"
    if int in kinds:
        return "3"
    if name == "known_m":
        return '["left_knee=0.43"]'
    if name == "view_rates_hz":
        return '["cam_2=60"]'
    if str in kinds:
        return '["cam_1", "cam_2"]' if get_origin(hint) is tuple else '"coco_17"'
    raise AssertionError(f"no example for {name}: {hint}")


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return list(value) if isinstance(value, tuple) else value
