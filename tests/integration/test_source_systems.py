"""Every place, option and test that docs/source-systems.md names exists, and every item has a complete row."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from posefuse.model.options.catalog import options_by_name
from tests.conftest import ROOT

SOURCE = ROOT / "src" / "posefuse"
PAGE = (ROOT / "docs" / "source-systems.md").read_text("utf-8")
COLUMNS = ["item", "location", "option", "difference", "measurement"]
SECTIONS = dict(re.findall(r"(?ms)^## (.*?)\n(.*?)(?=^## |\Z)", PAGE))


def rows_of(section: str) -> list[list[str]]:
    """Return the cells of the table in a section, without its heading."""
    lines = [line for line in SECTIONS[section].splitlines() if line.startswith("|")]
    table = [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines]
    assert table[0] == COLUMNS
    return table[2:]


ROWS = {f"{section}: {row[0]}": row for section in SECTIONS for row in rows_of(section)}
PLACES = sorted(
    {place for row in ROWS.values() for place in re.findall(r"`([\w/-]+\.(?:py|toml)(?::[\w.]+)?)`", " ".join(row))}
)


@cache
def names_in(path: Path) -> set[str]:
    """Return functions, classes, methods and constants of a file, methods as ``Class.method``."""
    names = set()

    def visit(body: list[ast.stmt], prefix: str) -> None:
        for node in body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.add(prefix + node.name)
            if isinstance(node, ast.ClassDef):
                visit(node.body, f"{prefix}{node.name}.")
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            names.update(prefix + target.id for target in targets if isinstance(target, ast.Name))

    visit(ast.parse(path.read_text("utf-8")).body, "")
    return names


def test_all_four_documents_have_a_table():
    assert len(SECTIONS) == 4
    assert all(len(rows_of(section)) >= 14 for section in SECTIONS)
    assert len(ROWS) == sum(len(rows_of(section)) for section in SECTIONS)


@pytest.mark.parametrize("row", ROWS.values(), ids=[re.sub(r"\W+", "_", name)[:60] for name in ROWS])
def test_row_is_complete(row):
    assert len(row) == len(COLUMNS)
    assert all(row)
    options = re.findall(r"`([^`]+)`", row[2])
    assert row[2] == "-" or options
    assert [name for name in options if name not in options_by_name()] == []


@pytest.mark.parametrize("place", PLACES)
def test_place_exists(place):
    file, _, name = place.partition(":")
    found = [root / file for root in (SOURCE, ROOT) if (root / file).is_file()]
    assert found, file
    assert not name or name in names_in(found[0])


def test_options_of_the_page_for_freemocap_users_exist():
    page = (ROOT / "docs" / "freemocap.md").read_text("utf-8").split("\n## Settings\n")[1].split("\n## ")[0]
    rows = re.findall(r"(?m)^\| [^|]+ \| ((?:`[\w.]+`(?:, )?)+) \|", page)
    named = [name for row in rows for name in re.findall(r"`([\w.]+)`", row)]
    assert len(named) > 12
    assert [name for name in named if name not in options_by_name()] == []
