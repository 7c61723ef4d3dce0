"""Edits as TOML: a table ``[[edit]]`` for each, in the order in which they are done; ``do`` says what."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_type_hints

import msgspec
import tomli_w

from posefuse.errors import EditError, choices, suggestion
from posefuse.io.files import must_exist, read_toml
from posefuse.model.edits import EDITS, Edit, name_of


def read_edits(path: str | Path) -> tuple[Edit, ...]:
    """Read edits.

    Raises:
        FileError: if there is no such file, or it is not TOML.
        EditError: on an entry that is none, with its number, what was expected and the choices.
    """
    path = must_exist(Path(path), "file of edits")
    data = read_toml(path)
    unknown = [key for key in data if key != "edit"]
    if unknown:
        raise EditError(f"{path.name}: unknown key {unknown[0]!r}. Edits are tables [[edit]].")
    entries = data.get("edit", [])
    if not isinstance(entries, list):
        raise EditError(f"{path.name}: edits are written [[edit]], with two brackets, each a table of its own.")
    if not entries:
        raise EditError(f"{path.name} holds no [[edit]]. Each has do = one of {choices(EDITS)}.")
    return tuple(_edit(entry, f"{path.name}, edit {number}") for number, entry in enumerate(entries, 1))


def edits_to_toml(edits: Sequence[Edit]) -> str:
    """Edits as TOML that :func:`read_edits` takes; what is not set is left out."""
    tables = []
    for edit in edits:
        values = {name: value for name, value in dataclasses.asdict(edit).items() if value is not None}
        tables.append({"do": name_of(edit)} | {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()})
    return tomli_w.dumps({"edit": tables})


def _edit(entry: Mapping[str, Any], where: str) -> Edit:
    if not isinstance(entry, Mapping) or "do" not in entry:
        raise EditError(f"{where}: do is missing. It is one of {choices(EDITS)}.")
    do = entry["do"]
    if not isinstance(do, str) or do not in EDITS:
        raise EditError(f"{where}: do cannot be {do!r}. {suggestion(str(do), EDITS)}")
    kind, where = EDITS[do], f"{where} ({do})"
    values = {key: value for key, value in entry.items() if key != "do"}
    hints = get_type_hints(kind)
    for key in values:
        if key not in hints:
            raise EditError(f"{where}: unknown key {key!r}. It has {choices(hints)}.")
    needed = [f.name for f in dataclasses.fields(kind) if f.default is dataclasses.MISSING]
    missing = [key for key in needed if key not in values]
    if missing:
        raise EditError(f"{where}: {missing[0]} is missing. It needs {choices(needed)}.")
    try:
        return kind(**{key: _value(hints[key], value, key) for key, value in values.items()})
    except EditError as error:
        raise EditError(f"{where}: {error}") from None


def _value(hint: Any, value: Any, key: str) -> Any:
    try:
        return msgspec.convert(value, hint)
    except msgspec.ValidationError as error:
        raise EditError(f"{key} cannot be {value!r}. {error}.") from None
