"""Edits as TOML: one table ``[[edit]]`` per edit, in the order of application. The key ``do`` names the operation."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_type_hints

import msgspec
import tomli_w

from posefuse.arguments import checked
from posefuse.errors import EditError, choices, suggestion
from posefuse.io.files import must_exist, read_toml
from posefuse.model.edits import EDITS, Edit, name_of


@checked
def read_edits(path: str | Path) -> tuple[Edit, ...]:
    """Read a file of edits.

    Raises:
        FileError: If the file does not exist or is not TOML.
        EditError: If an entry is invalid. The message states its number, the expected content and the choices.
    """
    path = must_exist(Path(path), "file of edits")
    data = read_toml(path)
    unknown = [key for key in data if key != "edit"]
    if unknown:
        raise EditError(f"{path.name}: unknown key {unknown[0]!r}. Edits are tables [[edit]].")
    entries = data.get("edit", [])
    if not isinstance(entries, list):
        raise EditError(f"{path.name}: write each edit as its own table [[edit]], with two brackets.")
    if not entries:
        raise EditError(f"{path.name} contains no [[edit]]. Each needs do = one of {choices(EDITS)}.")
    return tuple(_edit(entry, f"{path.name}, edit {number}") for number, entry in enumerate(entries, 1))


def edits_to_toml(edits: Sequence[Edit]) -> str:
    """Return edits as TOML for :func:`read_edits`. Values that are None are omitted."""
    tables = []
    for edit in edits:
        values = {name: value for name, value in dataclasses.asdict(edit).items() if value is not None}
        tables.append({"do": name_of(edit)} | {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()})
    return tomli_w.dumps({"edit": tables})


def _edit(entry: Mapping[str, Any], where: str) -> Edit:
    if not isinstance(entry, Mapping) or "do" not in entry:
        raise EditError(f"{where}: the key 'do' is missing. Set it to one of: {choices(EDITS)}.")
    do = entry["do"]
    if not isinstance(do, str) or do not in EDITS:
        raise EditError(f"{where}: unknown operation do = {do!r}. {suggestion(str(do), EDITS)}")
    kind, where = EDITS[do], f"{where} ({do})"
    values = {key: value for key, value in entry.items() if key != "do"}
    hints = get_type_hints(kind)
    for key in values:
        if key not in hints:
            raise EditError(f"{where}: unknown key {key!r}. Keys: {choices(hints)}.")
    required = [f.name for f in dataclasses.fields(kind) if f.default is dataclasses.MISSING]
    missing = [key for key in required if key not in values]
    if missing:
        raise EditError(f"{where}: {missing[0]} is missing. Required keys: {choices(required)}.")
    try:
        return kind(**{key: _value(hints[key], value, key) for key, value in values.items()})
    except EditError as error:
        raise EditError(f"{where}: {error}") from None


def _value(hint: Any, value: Any, key: str) -> Any:
    try:
        return msgspec.convert(value, hint)
    except msgspec.ValidationError as error:
        raise EditError(f"{key} cannot be {value!r}. {error}.") from None
