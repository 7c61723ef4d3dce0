"""Annotations are checked: every kind of hint, and the words of the messages."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

import numpy as np
import pytest

from posefuse.arguments import Shape, checked
from posefuse.errors import ArgumentError, OptionsError


class Named(Protocol):
    def start(self, what: str) -> None: ...


class Bar:
    def start(self, what: str) -> None: ...


HINTS: dict[str, tuple[Any, list[Any], list[Any]]] = {
    "float": (float, [1, 1.5, np.float64(2)], [True, "1", None, [1.0]]),
    "int": (int, [1, np.int64(1)], [1.5, True, None]),
    "optional": (str | None, ["a", None], [1]),
    "literal": (Literal["a", "b"], ["a"], ["c", None, [1]]),
    "path": (str | Path, ["a", Path("a")], [1.5, None]),
    "tuple": (tuple[str, ...], [("a",), ["a", "b"], ()], ["ab", [1], None, np.zeros(2)]),
    "pair": (tuple[int, int], [(1, 2), [1, 2]], [(1, 2, 3), (1.5, 2)]),
    "sequence": (Sequence[float], [[1.0], (1, 2), np.zeros(3)], ["ab", np.zeros((2, 2)), 1.0]),
    "mapping": (Mapping[str, float], [{"a": 1}], [{"a": "b"}, [1]]),
    "array": (np.ndarray, [np.zeros(2)], [[1.0], np.array(["a"]), None]),
    "shape": (Annotated[np.ndarray, Shape(..., 3)], [np.zeros(3), np.zeros((2, 3))], [np.zeros(2), np.zeros(())]),
    "function": (Callable[[int], int], [abs], [3]),
    "protocol": (Named, [Bar()], [1.5]),
}


@pytest.mark.parametrize("kind", HINTS)
def test_each_kind_of_annotation(kind):
    hint, valid, wrong = HINTS[kind]

    def call(value):
        return "called"

    call.__annotations__["value"] = hint
    guarded = checked(call)
    assert [guarded(value) for value in valid] == ["called"] * len(valid)
    for value in wrong:
        with pytest.raises(ArgumentError, match=r"call: value must be .*, got "):
            guarded(value)


@checked
class Pair:
    def __init__(self, name: str, values: np.ndarray) -> None:
        self.n = len(name) + values.ndim

    def twice(self, number: float) -> float:
        return number * 2.0

    def broken(self, number: float) -> float:
        return [number][7]

    def refused(self, number: float) -> float:
        raise OptionsError("number must be odd.")


def test_methods_are_explained_after_they_fail():
    with pytest.raises(ArgumentError, match=r"Pair: name must be a string, .*; values .* seem to be swapped"):
        Pair(np.zeros(2), "a")  # type: ignore[arg-type]
    pair = Pair("a", np.zeros(2))
    assert pair.twice(2) == 4
    with pytest.raises(ArgumentError, match="twice: number must be a number, got None"):
        pair.twice(None)  # type: ignore[arg-type]
    with pytest.raises(IndexError):
        pair.broken(1.0)
    with pytest.raises(OptionsError, match="odd"):
        pair.refused("a")  # type: ignore[arg-type]
