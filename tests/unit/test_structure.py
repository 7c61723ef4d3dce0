"""The limits of size that keep a file and a function readable."""

import ast
from pathlib import Path

import pytest

from tests.conftest import ROOT

MOST_LINES, MOST_BODY, MOST_KERNEL_BODY, MOST_ARGUMENTS = 400, 50, 80, 8
MOST_SCALARS = 13
"""The most arguments of inlined scalar arithmetic in kernels, which takes numbers one by one."""
SOURCES = sorted((ROOT / "src" / "posefuse").rglob("*.py"))


def functions_of(path: Path) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    tree = ast.parse(path.read_text("utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def body_lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    body = function.body[1:] if ast.get_docstring(function) else function.body
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0


def n_arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    arguments = function.args
    names = [each.arg for each in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
    return len([name for name in names if name not in ("self", "cls")])


def is_inline(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return "inline" in [ast.unparse(each) for each in function.decorator_list]


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT / "src")))
def test_file_and_functions_stay_below_the_size_limits(path: Path):
    kernel = "kernels" in path.parts
    longest = MOST_KERNEL_BODY if kernel else MOST_BODY
    too_long = [f"{each.name}: {body_lines(each)} lines" for each in functions_of(path) if body_lines(each) > longest]
    too_wide = [
        f"{each.name}: {n_arguments(each)} arguments"
        for each in functions_of(path)
        if n_arguments(each) > (MOST_SCALARS if kernel and is_inline(each) else MOST_ARGUMENTS)
    ]
    assert path.read_text("utf-8").count("\n") <= MOST_LINES
    assert not too_long
    assert not too_wide
