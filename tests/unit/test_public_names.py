"""The public names: one list for type checkers, one for use, and every options record in both."""

import ast
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path

import posefuse
from posefuse.model.options.options import Options


def names_for_type_checkers() -> list[tuple[str, str]]:
    """Return module and name of each import under ``TYPE_CHECKING``."""
    tree = ast.parse(Path(posefuse.__file__).read_text("utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    return [(node.module or "", alias.asname or "") for node in imports for alias in node.names]


def records_of(record: object) -> Iterator[str]:
    """Yield the class names of an options record and of the records in it."""
    yield type(record).__name__
    for field in fields(record):  # type: ignore[arg-type]
        if is_dataclass(value := getattr(record, field.name)):
            yield from records_of(value)


def test_both_lists_are_equal() -> None:
    used = [(f"posefuse.{module}", name) for name, module in posefuse._MODULE_OF.items()]
    assert sorted(names_for_type_checkers()) == sorted(used)


def test_names_exist() -> None:
    for name in posefuse.__all__:
        assert getattr(posefuse, name).__name__ == name


def test_options_records_are_public() -> None:
    assert set(records_of(Options())) - set(posefuse.__all__) == set()
