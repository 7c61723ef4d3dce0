"""Arguments of public functions and classes: wrong types are errors that name the argument.

``@checked`` reads the annotations. A function checks its arguments before any work. A class checks those of its
constructor and of its public methods only after they fail, so that a correct call costs nothing.
"""

import inspect
from collections.abc import Callable, Iterable, Mapping
from functools import cache, wraps
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from posefuse.errors import ArgumentError, PosefuseError, choices

T = TypeVar("T")
P = ParamSpec("P")
R = TypeVar("R")

_FAILURES = (TypeError, AttributeError, ValueError, IndexError, KeyError, OverflowError)
"""What a wrong argument causes."""


class Shape:
    """Shape of an array in an annotation: ``Annotated[np.ndarray, Shape(..., 3)]``.

    Args:
        *axes: lengths; None allows any length, and a first ``...`` any further axes before the others.
    """

    def __init__(self, *axes: Any) -> None:
        self.axes = axes

    def fits(self, shape: tuple[int, ...]) -> bool:
        """Return whether an array has this shape."""
        tail = self.axes[1:] if self.axes[:1] == (...,) else self.axes
        long_enough = len(shape) >= len(tail) if len(tail) < len(self.axes) else len(shape) == len(tail)
        ends = shape[len(shape) - len(tail) :] if tail else ()
        return long_enough and all(e is None or e == s for e, s in zip(tail, ends, strict=True))

    def __str__(self) -> str:
        return f"({', '.join('...' if e is ... else 'any' if e is None else str(e) for e in self.axes)})"


def checked(target: T) -> T:
    """Check the arguments of a function, or of the constructor and the public methods of a class.

    Raises:
        ArgumentError: at a call with an argument that does not fit its annotation.
    """
    if not inspect.isclass(target):
        return _before(target)  # type: ignore[arg-type,return-value]
    for name, member in list(vars(target).items()):
        function = getattr(member, "__func__", member)
        if not inspect.isfunction(function) or (name.startswith("_") and name != "__init__"):
            continue
        guard = _before if inspect.isgeneratorfunction(function) else _after
        guarded = guard(function)
        wrapped = type(member)(guarded) if isinstance(member, classmethod | staticmethod) else guarded
        setattr(target, name, wrapped)
    return target


def _before(function: Callable[P, R]) -> Callable[P, R]:
    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        problem = _problem(function, args, kwargs)
        if problem is not None:
            raise ArgumentError(problem)
        return function(*args, **kwargs)

    return call


def _after(function: Callable[P, R]) -> Callable[P, R]:
    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except _FAILURES as error:
            problem = None if isinstance(error, PosefuseError) else _problem(function, args, kwargs)
            if problem is None:
                raise
            raise ArgumentError(problem) from error

    return call


def _problem(function: Callable[..., Any], args: tuple[Any, ...], kwargs: Mapping[str, Any]) -> str | None:
    """Return what is wrong with the arguments of a call; None if each fits, or if the call lacks arguments."""
    signature, hints = _described(function)
    try:
        given = signature.bind(*args, **kwargs).arguments
    except TypeError:
        return None
    wrong = [name for name, value in given.items() if name in hints and not _fits(value, hints[name])]
    if not wrong:
        return None
    named = function.__qualname__.removesuffix(".__init__")
    parts = [f"{name} must be {_text(hints[name])}, got {_got(given[name])}" for name in wrong]
    swapped = len(wrong) == 2 and all(_fits(given[a], hints[b]) for a, b in (wrong, wrong[::-1]))
    hint = f" {wrong[0]} and {wrong[1]} seem to be swapped." if swapped else ""
    return f"{named}: {'; '.join(parts)}.{hint}"


@cache
def _described(function: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, Any]]:
    """Return the signature of a function and the resolved annotations that can be resolved."""
    signature = inspect.signature(function)
    try:
        hints = get_type_hints(function, include_extras=True)
    except (NameError, AttributeError, TypeError):
        # Annotations of generated constructors, and those that only type checkers import.
        annotations = {name: each.annotation for name, each in signature.parameters.items()}
        hints = {name: hint for name, hint in annotations.items() if not isinstance(hint, str)}
    return signature, hints


def _fits(value: Any, hint: Any) -> bool:
    origin, inside = get_origin(hint), get_args(hint)
    if hint is Any or isinstance(hint, TypeVar | str):
        return True
    if origin is Annotated:
        shapes = [each for each in inside[1:] if isinstance(each, Shape)]
        return _fits(value, inside[0]) and all(shape.fits(tuple(value.shape)) for shape in shapes)
    if origin in (Union, UnionType):
        return any(_fits(value, each) for each in inside)
    if origin is Literal:
        return isinstance(value, str | int | bool | NoneType) and value in inside
    if hint is np.ndarray:
        return hasattr(value, "shape") and getattr(getattr(value, "dtype", None), "kind", "O") in "biuf"
    if hint is float:
        return isinstance(value, Real) and not isinstance(value, bool)
    if hint is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    if origin is tuple or (inspect.isclass(origin) and issubclass(origin, Iterable)):
        return _fits_collection(value, origin, inside)
    if origin is not None:
        return (
            callable(value)
            if origin is Callable or (inspect.isclass(origin) and origin.__name__ == "Callable")
            else True
        )
    if getattr(hint, "_is_protocol", False):
        return all(hasattr(value, name) for name in vars(hint) if not name.startswith("_"))
    return isinstance(value, hint) if inspect.isclass(hint) else True


def _fits_collection(value: Any, origin: Any, inside: tuple[Any, ...]) -> bool:
    """Return whether the elements of a collection fit; a list may stand for a tuple."""
    if issubclass(origin, Mapping):
        whole = isinstance(value, Mapping)
        return whole and all(_fits(k, inside[0]) and _fits(v, inside[1]) for k, v in value.items())
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
        return False
    if not isinstance(value, list | tuple | set | frozenset | np.ndarray):
        return not issubclass(origin, tuple)
    if isinstance(value, np.ndarray) and not value.ndim:
        return False
    if origin is tuple and (len(inside) < 2 or inside[1] is not ...):
        return len(value) == len(inside) and all(_fits(v, each) for v, each in zip(value, inside, strict=True))
    return all(_fits(each, inside[0]) for each in value)


def _text(hint: Any) -> str:
    """Return an annotation in words."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin is Annotated:
        shapes = [str(each) for each in inside[1:] if isinstance(each, Shape)]
        return f"{_text(inside[0])} of shape {shapes[0]}" if shapes else _text(inside[0])
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(_text(each) for each in inside))
    if origin is Literal:
        return f"one of {choices(inside)}"
    if origin is Callable:
        return "a function"
    if origin is not None and inside:
        return f"a collection of {', '.join(_text(each) for each in inside if each is not ...)}"
    names = {NoneType: "None", np.ndarray: "an array of numbers", str: "a string", float: "a number", int: "an integer"}
    return names.get(hint) or f"a {getattr(hint, '__name__', hint)}"


def _got(value: Any) -> str:
    """Return a value in a few words."""
    if value is None:
        return "None"
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return f"an array of shape {tuple(value.shape)} and type {value.dtype}"
    if isinstance(value, str | int | float | list | tuple):
        text = repr(value)
        return text if len(text) <= 60 else f"{type(value).__name__} {text[:57]}..."
    return f"a {type(value).__name__}"
