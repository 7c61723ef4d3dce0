"""Declare the unit and the bounds of an option, and check every field of an options record against its declaration.

A record declares its numbers with ``option`` and calls ``check_fields`` first in ``__post_init__``::

    @dataclass(frozen=True)
    class MedianOptions:
        window_s: float = option(0.1, above=0.0)

        def __post_init__(self) -> None:
            check_fields(self, "postprocess.median")

Python construction, ``dataclasses.replace``, TOML files and command-line flags all construct the record, so all of them
pass the same check. The help, the file of ``posefuse init`` and ``docs/options.md`` read the same declarations.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from posefuse.errors import OptionsError, choices, suggestion

T = TypeVar("T")

_METADATA_KEY = "posefuse.bounds"

_UNIT_OF_SUFFIX = {
    "_m_s": "m/s", "_mm": "mm", "_m": "m", "_s": "s", "_hz": "Hz", "_px": "px", "_deg": "deg", "_kg": "kg",
    "_ppm": "ppm", "_sigma": "standard deviations", "_log_odds": "nats", "_share": "",
}  # fmt: skip
"""The unit that the end of an option's name stands for; longer endings come first."""


_FEWEST_MM = 1000.0
"""Lengths that are too large for meters are in cm below this, and in mm from this on."""
MIN_MAGNITUDE, MAX_MAGNITUDE = 1e-30, 1e30
"""Magnitudes of all numbers other than 0, in any unit: beyond, products would overflow or vanish."""


@dataclass(frozen=True)
class Bounds:
    """What the value of one option, or every element of a tuple of values, must satisfy.

    Attributes:
        above: Exclusive lower bound.
        at_least: Inclusive lower bound.
        below: Exclusive upper bound.
        at_most: Inclusive upper bound.
        infinite: Whether positive infinity is valid.
        unit: Unit of the number; the empty string for a dimensionless number, None to use the name's suffix.
        lengths: Valid numbers of elements of a tuple; empty if any number is valid.
        choices: Valid strings, for options whose type does not list them.
        common: Whether ``--help`` and the file that ``posefuse init`` writes show the option.
        example: TOML value that the template shows for an option without a default.
    """

    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    infinite: bool = False
    unit: str | None = None
    lengths: tuple[int, ...] = ()
    choices: tuple[str, ...] = ()
    common: bool = False
    example: str | None = None

    def contain(self, number: float) -> bool:
        """Return whether a number satisfies the bounds; NaN never does."""
        return (
            (_has_usual_magnitude(number) or (self.infinite and number == math.inf))
            and (self.above is None or number > self.above)
            and (self.at_least is None or number >= self.at_least)
            and (self.below is None or number < self.below)
            and (self.at_most is None or number <= self.at_most)
        )

    def range_text(self) -> str:
        """Return the range in words, such as ``above 0 and at most 1``; empty if there is no bound."""
        low, high = _lower_text(self), _upper_text(self)
        if self.at_least is not None and self.at_most is not None:
            return f"from {self.at_least:g} to {self.at_most:g}"
        if self.above is not None and self.below is not None:
            return f"between {self.above:g} and {self.below:g}, exclusive"
        return " and ".join(text for text in (low, high) if text)


def option(
    default: T,
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
    infinite: bool = False,
    **details: Any,
) -> T:
    """Return a dataclass field with a default and declared bounds.

    Args:
        default: Default value of the field.
        above: Exclusive lower bound of a number, or of every number of a tuple.
        at_least: Inclusive lower bound.
        below: Exclusive upper bound.
        at_most: Inclusive upper bound.
        infinite: Whether positive infinity is valid; NaN never is.
        **details: Further attributes of ``Bounds``: ``unit``, ``lengths``, ``choices``, ``common``, ``example``.
    """
    for name in ("lengths", "choices"):
        if name in details:
            details[name] = tuple(details[name])
    bounds = Bounds(above, at_least, below, at_most, infinite, **details)
    return dataclasses.field(default=default, metadata={_METADATA_KEY: bounds})  # type: ignore[return-value]


@cache
def bounds_of(field: "dataclasses.Field[Any]") -> Bounds:
    """Return the declared bounds of a dataclass field, with the unit resolved from the field's name."""
    bounds: Bounds = field.metadata.get(_METADATA_KEY, Bounds())
    if bounds.unit is not None:
        return bounds
    unit = next((unit for suffix, unit in _UNIT_OF_SUFFIX.items() if field.name.endswith(suffix)), "")
    return dataclasses.replace(bounds, unit=unit)


@cache
def field_hints(record: type) -> Mapping[str, Any]:
    """Return the resolved type of every field of a record, by field name."""
    return get_type_hints(record)


def check_fields(record: Any, path: str) -> None:
    """Check type, range and choice of every field of an options record.

    Lists become tuples, and whole numbers in fields of type float become floats, so that equal options are equal
    whether they come from Python, a TOML file or the command line.

    Args:
        record: Dataclass instance that is being constructed.
        path: Name of the table that holds the record, such as ``tracker.initiation``; empty at the top level.

    Raises:
        OptionsError: if a value is invalid. The message names every invalid field, its range and its valid choices.
    """
    hints, valid = field_hints(type(record)), _valid_defaults(type(record))
    prefix = f"{path}." if path else ""
    problems = []
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        if value is valid.get(field.name, dataclasses.MISSING):
            continue
        try:
            checked = _checked(value, hints[field.name], bounds_of(field))
        except ValueError as error:
            problems.append(f"{prefix}{field.name} must be {error}")
            continue
        if checked is not value:
            object.__setattr__(record, field.name, checked)
    if problems:
        raise OptionsError(" ".join(problems))


@cache
def _valid_defaults(record: type) -> Mapping[str, Any]:
    """Return the defaults of a record that its check leaves as they are, by field name.

    Most options of most records are these very objects, and records are copied often.
    """
    hints = field_hints(record)
    return {
        field.name: field.default
        for field in dataclasses.fields(record)
        if field.default is not dataclasses.MISSING and _is_valid(field.default, hints[field.name], bounds_of(field))
    }


def check_no_repetition(values: tuple[str, ...], name: str) -> None:
    """Check that no value of an option is given twice.

    Raises:
        OptionsError: if one is.
    """
    repeated = sorted({value for value in values if values.count(value) > 1})
    if repeated:
        raise OptionsError(f"{name} must not name anything twice, got {choices(repeated)} more than once.")


def check_one_of(record: Any, path: str, default: str, other: str) -> None:
    """Check that a field in one unit and the same field in another are not both given.

    Args:
        record: Dataclass instance that is being constructed.
        path: Name of the table that holds the record.
        default: Name of the field with a default.
        other: Name of the field that replaces it.

    Raises:
        OptionsError: if ``other`` is given and ``default`` is not at its default.
    """
    fields = {field.name: field for field in dataclasses.fields(record)}
    if getattr(record, other) is not None and getattr(record, default) != fields[default].default:
        raise OptionsError(f"{path}: {default} and {other} are given. Remove one of them.")


def expected_text(hint: Any, bounds: Bounds) -> str:
    """Return what the value of an option must be, such as ``a finite number above 0 s``.

    Args:
        hint: Type of the field.
        bounds: Declared bounds of the field.
    """
    inner = without_none(hint)
    if get_origin(inner) is tuple:
        numbers = " or ".join(str(length) for length in bounds.lengths if length)
        element = get_args(inner)[0]
        return f"a list of {numbers + ' ' if numbers else ''}{_element_text(element, bounds)}"
    allowed = valid_choices(inner, bounds)
    if allowed:
        return f"one of {choices(allowed, most=30)}"
    if inner is bool:
        return "true or false"
    if inner is str:
        return "a string"
    if dataclasses.is_dataclass(inner):
        return "a table of options"
    return f"{_number_text(inner, bounds)}"


def valid_choices(hint: Any, bounds: Bounds) -> tuple[str, ...]:
    """Return the valid strings of an option, or of the elements of a tuple; empty if it is not a choice."""
    if bounds.choices:
        return bounds.choices
    if get_origin(hint) is Literal:
        return get_args(hint)
    return tuple(value for part in get_args(hint) for value in valid_choices(part, bounds))


@cache
def without_none(hint: Any) -> Any:
    """Return a type without its ``| None``."""
    if get_origin(hint) in (Union, UnionType):
        parts = [part for part in get_args(hint) if part is not NoneType]
        return parts[0] if len(parts) == 1 else Union[tuple(parts)]  # noqa: UP007
    return hint


def _checked(value: Any, hint: Any, bounds: Bounds) -> Any:
    """Return the value in its field's type; the message of the ValueError says what it must be."""
    if value is None and NoneType in get_args(hint):
        return None
    inner = without_none(hint)
    if get_origin(inner) is tuple:
        return _checked_tuple(value, inner, bounds)
    checked = _checked_scalar(value, inner, bounds)
    if checked is None:
        allowed = valid_choices(inner, bounds)
        hint_text = f" {_did_you_mean(value, allowed)}" if isinstance(value, str) and allowed else ""
        hint_text += _magnitude_text(value) + _unit_text(value, bounds)
        raise ValueError(f"{expected_text(inner, bounds)}, got {value!r}.{hint_text}")
    return checked


def _is_valid(value: Any, hint: Any, bounds: Bounds) -> bool:
    """Return whether a value is valid and in its field's type."""
    try:
        return _checked(value, hint, bounds) is value
    except ValueError:
        return False


def _checked_tuple(value: Any, hint: Any, bounds: Bounds) -> tuple[Any, ...]:
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
        raise ValueError(f"{expected_text(hint, bounds)}, got {value!r}.")
    element, values = get_args(hint)[0], tuple(value)
    checked = tuple(_checked_scalar(each, element, bounds) for each in values)
    wrong = [each for each, result in zip(values, checked, strict=True) if result is None]
    if wrong:
        allowed = valid_choices(element, bounds)
        hint_text = f" {_did_you_mean(wrong[0], allowed)}" if isinstance(wrong[0], str) and allowed else ""
        hint_text += _magnitude_text(wrong[0])
        raise ValueError(f"{expected_text(hint, bounds)}, got the element {wrong[0]!r}.{hint_text}")
    if bounds.lengths and len(values) not in bounds.lengths:
        raise ValueError(f"{expected_text(hint, bounds)}, got {len(values)}.")
    if type(value) is tuple and all(a is b for a, b in zip(values, checked, strict=True)):
        return value
    return checked


def _checked_scalar(value: Any, hint: Any, bounds: Bounds) -> Any:
    """Return the value in its type, or None if it is invalid."""
    allowed = valid_choices(hint, bounds)
    if allowed:
        return value if isinstance(value, str) and value in allowed else None
    if hint is bool:
        return bool(value) if isinstance(value, bool | np.bool_) else None
    if hint is str:
        return value if isinstance(value, str) else None
    if isinstance(value, bool | np.bool_):
        return None
    if hint is int:
        return _within(int(value), bounds) if isinstance(value, Integral) else None
    if hint is float:
        return _within(_to_float(value), bounds) if isinstance(value, Real) else None
    return value if isinstance(value, hint) else None


def _to_float(value: Real) -> float:
    """Return a number as a float; NaN, which no option accepts, if it is too large for one."""
    try:
        return value if type(value) is float else float(value)
    except OverflowError:
        return math.nan


def _within(number: Any, bounds: Bounds) -> Any:
    return number if bounds.contain(number) else None


def _did_you_mean(value: str, allowed: tuple[str, ...]) -> str:
    text = suggestion(value, allowed)
    return text if text.startswith("Did") else ""


def _has_usual_magnitude(number: float) -> bool:
    """Return whether products of a number neither overflow nor vanish; false for NaN and infinity."""
    return number == 0.0 or MIN_MAGNITUDE <= abs(number) <= MAX_MAGNITUDE


def _unit_text(value: Any, bounds: Bounds) -> str:
    """Return the value in meters, if it was given in centimeters or millimeters."""
    if bounds.unit != "m" or bounds.at_most is None or isinstance(value, bool) or not isinstance(value, Real):
        return ""
    number = _to_float(value)
    if not bounds.at_most < number < math.inf:
        return ""
    factor, unit = (100.0, "cm") if number < _FEWEST_MM else (1000.0, "mm")
    return f" Lengths are in meters: {number:g} {unit} are {number / factor:g}."


def _magnitude_text(value: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(number := _to_float(value)):
        return ""
    if _has_usual_magnitude(number):
        return ""
    return f" The magnitude of a number other than 0 must be from {MIN_MAGNITUDE:g} to {MAX_MAGNITUDE:g}."


def _lower_text(bounds: Bounds) -> str:
    if bounds.above is not None:
        return f"above {bounds.above:g}"
    return "" if bounds.at_least is None else f"at least {bounds.at_least:g}"


def _upper_text(bounds: Bounds) -> str:
    if bounds.below is not None:
        return f"below {bounds.below:g}"
    return "" if bounds.at_most is None else f"at most {bounds.at_most:g}"


def _number_text(hint: Any, bounds: Bounds) -> str:
    kind = "an integer" if hint is int else "a number" if bounds.infinite else "a finite number"
    text, unit = bounds.range_text(), f" {bounds.unit}" if bounds.unit else ""
    if not text:
        return f"{kind} in{unit}" if unit else kind
    separator = " of " if text.startswith("at ") else " "
    text = text.replace(", exclusive", f"{unit}, exclusive") if text.endswith(", exclusive") else f"{text}{unit}"
    infinite = " or inf" if bounds.infinite else ""
    return f"{kind}{separator}{text}{infinite}"


def _element_text(hint: Any, bounds: Bounds) -> str:
    if valid_choices(hint, bounds):
        return f"choices from {choices(valid_choices(hint, bounds), most=30)}"
    if hint is str:
        return "strings"
    text = _number_text(hint, bounds)
    for singular, plural in (
        ("an integer", "integers"),
        ("a number", "numbers"),
        ("a finite number", "finite numbers"),
    ):
        text = text.replace(singular, plural)
    return text
