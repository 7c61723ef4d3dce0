"""Random values for every option, for tests that accept a run with sane output or an error that names the option."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, get_args, get_origin

import numpy as np

from posefuse.model.options.bounds import Bounds, valid_choices, without_none
from posefuse.model.options.catalog import OptionEntry, list_options
from posefuse.model.options.options import Options

PROFILES: tuple[Mapping[str, Any], ...] = (
    {},
    {"people": "many"},
    {"bodies": "fit"},
    {"people": "one", "bodies": "fit", "tracker.smoother": "lag"},
    {"tracker.strategy": "specification"},
    {"association.method": "rpt", "people": "many"},
    {"solve": "trajectory", "people": "one"},
    {"solve": "trajectory", "postprocess.fill": "linear", "postprocess.max_gap_s": 0.3},
    {"pairs": "sds", "people": "one"},
    {"pairs": "enumerate", "sides": "votes"},
    {"pairs": "enumerate", "sides": "plane"},
    {"postprocess.smooth": ("hampel", "butterworth", "median"), "postprocess.fill": "pchip"},
    {"postprocess.smooth": ("savgol", "one_euro", "kalman"), "postprocess.fill": "smoother"},
    {"postprocess.drop_beyond_px": 8.0, "postprocess.fill": "linear", "postprocess.rigid_bones": True},
    {"align.origin": "subject", "align.forward": "subject", "align.height_m": 1.7},
    {"triangulation.method": "weighted_subsets"},
    {"triangulation.method": "percentile_filter"},
    {"triangulation.method": "ransac"},
    {"triangulation.method": "irls"},
    {"triangulation.confidence_exponent": 1.0, "triangulation.method": "simple"},
)
"""Options that run the stages to which the drawn options belong."""

NAMES = {
    "person": ("person_1", "person_2"),
    "skeleton": ("body_20", "coco_17"),
    "view_rates_hz": ("cam_0=25", "cam_1=50", "cam_2=nan", "cam_0"),
    "reference_view": ("cam_0", "cam_2"),
    "cameras": ("cam_0", "cam_1", "cam_2"),
    "exclude_camera": ("cam_0", "cam_1"),
    "camera_order": ("cam_0", "cam_1", "cam_2"),
    "sync.cameras": ("cam_0", "cam_1"),
    "align.length_between": ("left_knee", "left_ankle", "neck"),
    "tracker.known_m": ("left_knee=0.43", "left_knee=-1", "no_such=1"),
}
"""Names that occur in the recordings, by option."""

WRONG_TYPES = ("text", "", True, None, (), (1.0, 2.0), {"a": 1}, 1j, b"1", np.float32(np.nan))
EXTREMES = (math.nan, math.inf, -math.inf, -1.0, -1, 0.0, 0, 1e-300, 1e300, 1e-30, 1e30, 1e9, 1e-9, 10**9, 10**30)


def drawn_options(rng: np.random.Generator) -> dict[str, Any]:
    """Return values of some options by dotted name: those of a profile, and one to six drawn ones."""
    entries = list(list_options(Options))
    values = dict(PROFILES[rng.integers(len(PROFILES))])
    for i in rng.choice(len(entries), int(rng.integers(1, 7)), replace=False):
        values[entries[i].name] = value_of(entries[i], rng)
    return values


def with_values(values: Mapping[str, Any]) -> Options:
    """Return the options with values by dotted name; values of the same table are set together."""

    def table(record: Any, prefix: str) -> Any:
        own = {}
        for field in dataclasses.fields(record):
            name = f"{prefix}{field.name}"
            inner = getattr(record, field.name)
            if dataclasses.is_dataclass(inner) and any(each.startswith(f"{name}.") for each in values):
                own[field.name] = table(inner, f"{name}.")
            elif name in values:
                own[field.name] = values[name]
        return dataclasses.replace(record, **own)

    return table(Options(), "")


def value_of(entry: OptionEntry, rng: np.random.Generator) -> Any:
    """Return a value for an option: mostly one of its type, sometimes an extreme or one of a wrong type."""
    kind = rng.random()
    if kind < 0.03:
        return WRONG_TYPES[rng.integers(len(WRONG_TYPES))]
    inner = without_none(entry.hint)
    if get_origin(inner) is tuple:
        lengths = entry.bounds.lengths or (0, 1, 2, 3)
        n = int(rng.choice(lengths)) if kind < 0.95 else int(rng.integers(0, 8))
        return tuple(_scalar(entry, get_args(inner)[0], rng, extreme=kind < 0.1) for _ in range(n))
    return _scalar(entry, inner, rng, extreme=kind < 0.15)


def _scalar(entry: OptionEntry, hint: Any, rng: np.random.Generator, *, extreme: bool) -> Any:
    allowed = valid_choices(hint, entry.bounds)
    if allowed:
        return "no such choice" if extreme and rng.random() < 0.3 else str(rng.choice(allowed))
    if hint is bool:
        return bool(rng.integers(2))
    if hint is str:
        names = NAMES.get(entry.name, ())
        return str(rng.choice(names)) if names and not extreme else "no such name"
    if extreme:
        return EXTREMES[rng.integers(len(EXTREMES))]
    number = _number(entry.bounds, entry.default, rng)
    return round(number) if hint is int else number


def _number(bounds: Bounds, default: Any, rng: np.random.Generator) -> float:
    """Return a number within the bounds: an end of the range, or one within some orders of magnitude of the default."""
    low = bounds.above if bounds.at_least is None else bounds.at_least
    high = bounds.below if bounds.at_most is None else bounds.at_most
    if rng.random() < 0.15:
        ends = [end for end in (low, high) if end is not None]
        if ends:
            return float(ends[rng.integers(len(ends))])
    if low is not None and high is not None and math.isfinite(high) and rng.random() < 0.5:
        return float(rng.uniform(low, high))
    middle = default if isinstance(default, int | float) and default and math.isfinite(default) else 1.0
    number = float(abs(middle) * 10.0 ** rng.normal(0.0, 1.5))
    return -number if low is None and rng.random() < 0.5 else number
