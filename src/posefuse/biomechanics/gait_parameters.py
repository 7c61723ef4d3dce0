"""Spatio-temporal parameters of gait, each with its standard deviation over steps and the 95 % interval of its mean.

Cadence, speed and stride length rest on the same strides: speed is stride length times cadence over 120.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from posefuse.biomechanics.contact_times import Interval
from posefuse.biomechanics.foot_paths import HEEL, SIDES, FootPaths
from posefuse.biomechanics.gait_events import GaitEvent, foot_stances, steps_of, strides_of
from posefuse.biomechanics.mean_intervals import (
    MIN_VALUES,
    NO_INTERVAL,
    Scale,
    difference_interval,
    mean_interval,
    scale_of,
)

_REST_SHARE = (0.1, 0.5)
"""Part of a stance in which the heel rests, as shares from heel strike to toe-off."""
_TOUCHED_SHARE = 0.8
"""Share of a stance in which contact shows the foot on the ground; strike and toe-off are means of two methods."""
_SYMMETRIC = ("step_length_m", "step_time_s", "stance_percent", "single_support_percent")


@dataclass(frozen=True)
class GaitParameter:
    """A parameter of one person.

    Attributes:
        name: name with the unit as suffix.
        side: ``left``, ``right`` or ``both``.
        value: mean over steps or strides.
        sd: standard deviation over steps or strides, NaN for a single one; of an asymmetry, its standard error.
        n: number of steps or strides; of an asymmetry, that of the side with fewer.
        low95: lower end of the 95 % interval of the mean, NaN for fewer than four values.
        high95: upper end.
    """

    name: str
    side: str
    value: float
    sd: float
    n: int
    low95: float
    high95: float


def gait_parameters(
    paths: FootPaths, events: list[GaitEvent], contacts: list[list[list[Interval]]], ground_m_s: np.ndarray
) -> list[GaitParameter]:
    """Return the parameters of all bouts together; none without strides.

    Events that only one method found count for none, and a stance counts if contact shows it: feet that slide in every
    step have strikes and toe-offs by their extremes, but touch the ground only briefly.

    Args:
        paths: paths of the person.
        events: heel strikes and toe-offs.
        contacts: contact intervals by side and part.
        ground_m_s: shape (2,): velocity of a treadmill's belt, zero overground.
    """
    steps = _Steps.of(paths, events, contacts, ground_m_s)
    for first, last in strides_of(events):
        steps.add_stride(first, last)
    for before, strike in steps_of(events):
        steps.add_step(before, strike)
    return _summaries(steps.values)


@dataclass(frozen=True, eq=False)
class _Steps:
    """Heel strikes, toe-offs, and the values collected from them.

    Attributes:
        strikes: heel strikes in order.
        offs: toe-offs in order that both methods found.
        stances: contact of each foot.
        places_m: horizontal position of the resting heel after each strike.
        values: values by parameter and side.
    """

    strikes: list[GaitEvent]
    offs: list[GaitEvent]
    stances: list[list[Interval]]
    places_m: dict[GaitEvent, np.ndarray]
    values: dict[tuple[str, str], list[float]]

    @classmethod
    def of(
        cls, paths: FootPaths, events: list[GaitEvent], contacts: list[list[list[Interval]]], ground_m_s: np.ndarray
    ) -> "_Steps":
        strikes = [event for event in events if event.kind == "heel_strike" and not event.closing]
        offs = [event for event in events if event.kind == "toe_off"]
        places = {strike: _place(paths, strike, _next(offs, strike), ground_m_s) for strike in strikes}
        return cls(
            strikes, [off for off in offs if off.agreed], [foot_stances(parts) for parts in contacts], places, {}
        )

    def add(self, name: str, side: int, value: float) -> None:
        """Add a value, unless it is unknown."""
        if np.isfinite(value):
            self.values.setdefault((name, SIDES[side]), []).append(float(value))

    def touches(self, side: int, start_s: float, end_s: float) -> bool:
        """Return whether a foot touches the ground in most of an interval."""
        inside = (min(each.end_s, end_s) - max(each.start_s, start_s) for each in self.stances[side])
        return sum(max(duration, 0.0) for duration in inside) >= _TOUCHED_SHARE * (end_s - start_s)

    def add_step(self, before: GaitEvent, strike: GaitEvent) -> None:
        """Add the parameters of a step from the other foot's strike to this one."""
        duration = strike.time_s - before.time_s
        self.add("step_time_s", strike.side, duration)
        own = [each for each in self.strikes if each.side == strike.side and each.time_s < before.time_s]
        if own and own[-1].bout == strike.bout:
            length, width = _step(*(self.places_m[each] for each in (own[-1], before, strike)))
            self.add("step_length_m", strike.side, length)
            self.add("step_width_m", strike.side, width)

    def add_stride(self, first: GaitEvent, last: GaitEvent) -> None:
        """Add the parameters of a stride; none without the places of the heel, so that all rest on the same strides."""
        duration, side = last.time_s - first.time_s, first.side
        length = float(np.linalg.norm(self.places_m[last] - self.places_m[first]))
        if not np.isfinite(length):
            return
        self.add("stride_time_s", side, duration)
        self.add("stride_length_m", side, length)
        off = _next(self.offs, first)
        if off is None or off.time_s >= last.time_s or not self.touches(side, first.time_s, off.time_s):
            return
        stance = off.time_s - first.time_s
        self.add("stance_time_s", side, stance)
        self.add("stance_percent", side, 100.0 * stance / duration)
        self.add("swing_time_s", side, duration - stance)
        self.add("swing_percent", side, 100.0 * (1.0 - stance / duration))
        # The other foot leaves and strikes again; in running it leaves before this foot strikes.
        other = next(
            (each for each in self.strikes if each.side != side and first.time_s < each.time_s < last.time_s), None
        )
        leaves = [each.time_s for each in self.offs if each.side != side]
        if other is None or not other.agreed:
            return
        leave = max((time for time in leaves if time < other.time_s), default=np.nan)
        if not first.time_s - 0.3 * duration < leave < off.time_s:
            return
        double = max(leave - first.time_s, 0.0) + max(off.time_s - other.time_s, 0.0)
        single = min(off.time_s, other.time_s) - max(first.time_s, leave)
        flight = max(first.time_s - leave, 0.0) + max(other.time_s - off.time_s, 0.0)
        self.add("double_support_percent", side, 100.0 * double / duration)
        self.add("single_support_percent", side, 100.0 * single / duration)
        self.add("flight_percent", side, 100.0 * flight / duration)


def _next(offs: list[GaitEvent], strike: GaitEvent) -> GaitEvent | None:
    """Return the toe-off that ends the stance after a heel strike."""
    later = (off for off in offs if off.side == strike.side and strike.time_s < off.time_s < strike.time_s + 3.0)
    return next(later, None)


def _place(paths: FootPaths, strike: GaitEvent, off: GaitEvent | None, ground_m_s: np.ndarray) -> np.ndarray:
    """Return the horizontal position of the resting heel on the ground, shape (2,); NaN without points."""
    duration = 0.6 if off is None else off.time_s - strike.time_s
    first, last = (strike.time_s + share * duration for share in _REST_SHARE)
    inside = (paths.time_s >= first) & (paths.time_s <= last)
    heel = paths.feet_m[inside, strike.side, HEEL, :2] - paths.time_s[inside, None] * ground_m_s
    heel = heel[np.isfinite(heel[:, 0])]
    return np.median(heel, axis=0) if len(heel) else np.full(2, np.nan)


def _step(earlier: np.ndarray, other: np.ndarray, strike: np.ndarray) -> tuple[float, float]:
    """Return the length and width of a step along and across the stride of the striking foot."""
    along = strike - earlier
    size = float(np.linalg.norm(along))
    if not size > 0.05:
        return float("nan"), float("nan")
    ahead = strike - other
    return float(ahead @ along) / size, abs(float(along[0] * ahead[1] - along[1] * ahead[0])) / size


def _summaries(values: dict[tuple[str, str], list[float]]) -> list[GaitParameter]:
    """Return the parameters of each side, of both sides, and their symmetry."""
    found = []
    for name in dict.fromkeys(name for name, _ in values):
        sides = {side: np.array(values.get((name, side), [])) for side in SIDES}
        every = {**sides, "both": np.concatenate(list(sides.values()))}
        found += [summary(name, side, each) for side, each in every.items() if len(each)]
        if name == "stride_time_s":
            found += [_cadence(each) for each in found if each.name == name]
        if name == "stride_length_m":
            times = {side: np.array(values.get(("stride_time_s", side), [])) for side in SIDES}
            times["both"] = np.concatenate(list(times.values()))
            found += [_speed(side, each, times[side]) for side, each in every.items() if len(each)]
        if name in _SYMMETRIC and min(len(each) for each in sides.values()) > 1:
            found += _asymmetry(name, *sides.values())
    return found


def summary(name: str, side: str, values: np.ndarray) -> GaitParameter:
    """Return the mean and the standard deviation, and the 95 % interval of the mean if there are enough values.

    Args:
        name: name of the parameter with its unit as suffix.
        side: ``left``, ``right`` or ``both``.
        values: shape (value,): at least one.
    """
    n, mean = len(values), float(values.mean())
    sd = float(values.std(ddof=1)) if n > 1 else float("nan")
    return _parameter(name, side, mean, sd, n, scale_of(name, values))


def _parameter(name: str, side: str, mean: float, sd: float, n: int, scale: Scale) -> GaitParameter:
    ends = NO_INTERVAL if n < MIN_VALUES else mean_interval(mean, sd / np.sqrt(n), n - 1, scale)
    return GaitParameter(name, side, mean, sd, n, *ends)


def _cadence(stride_time: GaitParameter) -> GaitParameter:
    """Return the steps per minute of a mean stride time, so that errors of single strikes cancel."""
    value, n = 120.0 / stride_time.value, stride_time.n
    return _parameter(
        "cadence_steps_min", stride_time.side, value, value * stride_time.sd / stride_time.value, n, "log"
    )


def _speed(side: str, lengths_m: np.ndarray, times_s: np.ndarray) -> GaitParameter:
    """Return the length of all strides over their time, so that it is the product of stride length and cadence."""
    n, value = len(lengths_m), float(lengths_m.sum() / times_s.sum())
    # The standard deviation of a ratio of means is that of its residuals (Cochran 1977, Sampling Techniques, 6.3).
    rest = (lengths_m - value * times_s) / times_s.mean()
    sd = float(np.sqrt(np.square(rest).sum() / (n - 1))) if n > 1 else float("nan")
    return _parameter("speed_m_s", side, value, sd, n, "log" if value > 0.0 else "linear")


def _asymmetry(name: str, left: np.ndarray, right: np.ndarray) -> list[GaitParameter]:
    """Return the difference right minus left as a percentage of their mean; none of means that are not positive."""
    value, error, low, high = difference_interval(left, right)
    if not np.isfinite(value):
        return []
    stem = name.rsplit("_", 1)[0]
    return [GaitParameter(f"{stem}_asymmetry_percent", "both", value, error, min(len(left), len(right)), low, high)]


def mean_of(parameters: Iterable[GaitParameter], name: str, side: str = "both") -> GaitParameter | None:
    """Return a parameter of one side or of both, or None without it."""
    return next((each for each in parameters if each.name == name and each.side == side), None)
