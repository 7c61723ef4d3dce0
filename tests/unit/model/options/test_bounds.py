"""Declared bounds: every field of every options record refuses NaN, wrong types and values outside its range."""

import dataclasses
import importlib
import math
import pkgutil
from types import NoneType
from typing import Any, get_args, get_origin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import posefuse.model.options as model_options
from posefuse.described import Description
from posefuse.errors import OptionsError
from posefuse.model.options.bounds import (
    Bounds,
    bounds_of,
    check_fields,
    expected_text,
    field_hints,
    option,
    valid_choices,
    without_none,
)
from posefuse.model.options.calibration import PeopleOptions
from posefuse.model.options.catalog import OptionEntry
from posefuse.model.options.tracker import TrackerOptions
from tests.properties import examples

OUTSIDE_MODEL = ("posefuse.synthetic.options", "posefuse.synthetic.crowd_options")


def all_records() -> list[type]:
    """Return every options record of the package."""
    modules = [module.name for module in pkgutil.iter_modules(model_options.__path__, "posefuse.model.options.")]
    records = {
        value
        for module in (*modules, *OUTSIDE_MODEL)
        for value in vars(importlib.import_module(module)).values()
        if isinstance(value, type)
        and dataclasses.is_dataclass(value)
        and value not in (Bounds, Description, OptionEntry)
    }
    return sorted(records, key=lambda record: record.__name__)


RECORDS = all_records()
FIELDS = [(record, field) for record in RECORDS for field in dataclasses.fields(record)]
BY_NAME = pytest.mark.parametrize(
    ("record", "field"), FIELDS, ids=[f"{record.__name__}.{field.name}" for record, field in FIELDS]
)


@BY_NAME
def test_number_declares_bounds(record: type, field: dataclasses.Field[Any]) -> None:
    inner = without_none(field_hints(record)[field.name])
    element = get_args(inner)[0] if get_origin(inner) is tuple else inner
    if element in (int, float):
        bounds = bounds_of(field)
        assert bounds.range_text() or bounds.unit, "declare bounds, or a unit if every finite number is valid"


@BY_NAME
@given(data=st.data())
@examples(12)
def test_invalid_value_names_field_and_range(record: type, field: dataclasses.Field[Any], data: st.DataObject) -> None:
    hint, bounds = field_hints(record)[field.name], bounds_of(field)
    value = data.draw(st.sampled_from(invalid_values(hint, bounds)))
    with pytest.raises(OptionsError) as caught:
        record(**{field.name: value})
    assert f"{field.name} must be {expected_text(hint, bounds)}, got" in str(caught.value)


def invalid_values(hint: Any, bounds: Any) -> list[Any]:
    """Return values that a field must refuse: wrong types, NaN, infinity, and numbers outside its range."""
    inner = without_none(hint)
    wrong: list[Any] = [] if NoneType in get_args(hint) else [None]
    if get_origin(inner) is tuple:
        element = get_args(inner)[0]
        length = max((1, *bounds.lengths))
        inside = [value for value in invalid_values(element, bounds) if not isinstance(value, dict)]
        wrong += ["text", 3, {"a": 1}] + [(value,) * length for value in inside]
        return wrong
    numbers: list[Any] = [math.nan, math.inf, -math.inf, -1, 0, -1.0, 0.0, 1e30, np.float32(math.nan), 10**400]
    if inner is float:
        wrong += ["1", "", True, np.True_, 1j, (), {}]
        return wrong + [n for n in numbers if (isinstance(n, int) and n > 1e308) or not bounds.contain(float(n))]
    if inner is int:
        wrong += ["1", True, 1.0, 2.5, math.nan, math.inf, (), {}]
        return wrong + [n for n in (-1, 0, 1, -(10**9)) if not bounds.contain(n)]
    if inner is bool:
        return [*wrong, 0, 1, "true", 1.0]
    if valid_choices(inner, bounds):
        return [*wrong, "no such choice", "", 3, True, ("a",)]
    if inner is str:
        return [*wrong, 3, True, ("a",), math.nan]
    return [*wrong, 3, "text", {}, True]


@dataclasses.dataclass(frozen=True)
class Sample:
    share: float = option(0.5, above=0.0, at_most=1.0)
    window_s: float = option(0.1, at_least=0.0)
    ratio: float = option(0.1, above=0.0, below=0.5)
    reach_m: float = option(1.0, above=0.0, infinite=True)
    number: int | None = option(None, at_least=2)
    size: tuple[int, ...] = option((), at_least=1, lengths=(0, 2), unit="px")
    method: str = option("a", choices=("alpha", "a"))

    def __post_init__(self) -> None:
        check_fields(self, "stage.sample")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"share": 0.0}, "stage.sample.share must be a finite number above 0 and at most 1, got 0.0."),
        ({"window_s": -1}, "stage.sample.window_s must be a finite number of at least 0 s, got -1."),
        ({"ratio": 0.5}, "stage.sample.ratio must be a finite number between 0 and 0.5, exclusive, got 0.5."),
        ({"reach_m": math.nan}, "stage.sample.reach_m must be a number above 0 m or inf, got nan."),
        (
            {"share": 1e-31},
            "stage.sample.share must be a finite number above 0 and at most 1, got 1e-31. The magnitude of a number "
            "other than 0 must be from 1e-30 to 1e+30.",
        ),
        ({"number": True}, "stage.sample.number must be an integer of at least 2, got True."),
        ({"size": (3,)}, "stage.sample.size must be a list of 2 integers of at least 1 px, got 1."),
        ({"size": (3, 0)}, "stage.sample.size must be a list of 2 integers of at least 1 px, got the element 0."),
        ({"method": "alhpa"}, "stage.sample.method must be one of alpha, a, got 'alhpa'. Did you mean 'alpha'?"),
    ],
)
def test_message_names_the_value_and_the_range(values: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionsError) as caught:
        Sample(**values)
    assert str(caught.value) == message


def test_all_invalid_fields_are_reported_together() -> None:
    with pytest.raises(OptionsError, match=r"sample\.share .*sample\.window_s"):
        Sample(share=2.0, window_s=-1.0)


def test_replace_is_checked() -> None:
    with pytest.raises(OptionsError, match="share"):
        dataclasses.replace(Sample(), share=2.0)


def test_values_take_the_type_of_their_field() -> None:
    sample = Sample(window_s=1, number=np.int64(3), size=[640, 480])  # type: ignore[arg-type]
    assert (type(sample.window_s), type(sample.number), sample.size) == (float, int, (640, 480))
    assert Sample(reach_m=math.inf).reach_m == math.inf


@pytest.mark.parametrize(("number", "text"), [(178, "178 cm are 1.78"), (1780.0, "1780 mm are 1.78")])
@pytest.mark.parametrize("make", [lambda m: PeopleOptions(stature_m=m), lambda m: TrackerOptions(stature_m=m)])
def test_lengths_in_other_units_are_named(make: Any, number: float, text: str) -> None:
    with pytest.raises(OptionsError, match=rf"at most 100 m, got .*Lengths are in meters: {text}"):
        make(number)
