"""Spatio-temporal parameters of gait, each with its standard deviation over steps and the 95 % interval of its mean."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import stdtrit

from posefuse.biomechanics.foot_paths import HEEL, SIDES, FootPaths
from posefuse.biomechanics.gait_events import GaitEvent, strides_of

_REST_SHARE = (0.1, 0.5)
"""Part of a stance in which the heel rests, as shares from heel strike to toe-off."""
_SYMMETRIC = ("step_length_m", "step_time_s", "stance_percent", "single_support_percent")


@dataclass(frozen=True)
class GaitParameter:
    """A parameter of one person.

    Attributes:
        name: name with the unit as suffix.
        side: ``left``, ``right`` or ``both``.
        value: mean over steps or strides.
        sd: standard deviation over steps or strides, NaN for a single one.
        n: number of steps or strides.
        low95: lower end of the 95 % interval of the mean, NaN for a single one.
        high95: upper end.
    """

    name: str
    side: str
    value: float
    sd: float
    n: int
    low95: float
    high95: float


def gait_parameters(paths: FootPaths, events: list[GaitEvent], ground_m_s: np.ndarray) -> list[GaitParameter]:
    """Return the parameters of all bouts together; none without strides.

    Args:
        paths: paths of the person.
        events: heel strikes and toe-offs.
        ground_m_s: shape (2,): velocity of a treadmill's belt, zero overground.
    """
    steps = _Steps.of(paths, events, ground_m_s)
    for first, last in strides_of(events):
        steps.add_stride(first, last)
    for before, strike in pairwise(steps.strikes):
        if before.bout == strike.bout and before.side != strike.side and before.agreed and strike.agreed:
            steps.add_step(before, strike)
    return _summaries(steps.values)


@dataclass(frozen=True, eq=False)
class _Steps:
    """Heel strikes, toe-offs, and the values collected from them.

    Attributes:
        strikes: heel strikes in order.
        offs: toe-offs in order.
        places_m: horizontal position of the resting heel after each strike.
        values: values by parameter and side.
    """

    strikes: list[GaitEvent]
    offs: list[GaitEvent]
    places_m: dict[GaitEvent, np.ndarray]
    values: dict[tuple[str, str], list[float]]

    @classmethod
    def of(cls, paths: FootPaths, events: list[GaitEvent], ground_m_s: np.ndarray) -> "_Steps":
        strikes = [event for event in events if event.kind == "heel_strike" and not event.closing]
        offs = [event for event in events if event.kind == "toe_off"]
        places = {strike: _place(paths, strike, _next(offs, strike), ground_m_s) for strike in strikes}
        return cls(strikes, offs, places, {})

    def add(self, name: str, side: int, value: float) -> None:
        """Add a value, unless it is unknown."""
        if np.isfinite(value):
            self.values.setdefault((name, SIDES[side]), []).append(float(value))

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
        """Add the parameters of a stride."""
        duration, side = last.time_s - first.time_s, first.side
        length = float(np.linalg.norm(self.places_m[last] - self.places_m[first]))
        self.add("stride_time_s", side, duration)
        self.add("stride_length_m", side, length)
        self.add("speed_m_s", side, length / duration)
        off = _next(self.offs, first)
        if off is None or off.time_s >= last.time_s:
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
        if other is None:
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
        sides = [np.array(values.get((name, side), [])) for side in SIDES]
        found += [summary(name, side, each) for side, each in zip(SIDES, sides, strict=True) if len(each)]
        found.append(summary(name, "both", np.concatenate(sides)))
        if name == "step_time_s":
            found += [_cadence(each) for each in found if each.name == name]
        if name in _SYMMETRIC and min(len(each) for each in sides) > 1:
            found.append(_asymmetry(name, *sides))
    return found


def summary(name: str, side: str, values: np.ndarray) -> GaitParameter:
    """Return the mean, the standard deviation, and the 95 % interval of the mean by Student's t-distribution."""
    n, mean = len(values), float(values.mean())
    if n < 2:
        return GaitParameter(name, side, mean, float("nan"), n, float("nan"), float("nan"))
    sd = float(values.std(ddof=1))
    half = float(stdtrit(n - 1, 0.975)) * sd / np.sqrt(n)
    return GaitParameter(name, side, mean, sd, n, mean - half, mean + half)


def _cadence(step_time: GaitParameter) -> GaitParameter:
    """Return the steps per minute of a mean step time, so that errors of single strikes cancel."""
    value = 60.0 / step_time.value
    sd = value * step_time.sd / step_time.value
    # Short steps are fast; the interval of few steps may contain a time of zero.
    high = 60.0 / step_time.low95 if step_time.low95 > 0.0 else np.inf if step_time.n > 1 else np.nan
    return GaitParameter("cadence_steps_min", step_time.side, value, sd, step_time.n, 60.0 / step_time.high95, high)


def _asymmetry(name: str, left: np.ndarray, right: np.ndarray) -> GaitParameter:
    """Return the difference right minus left as a percentage of their mean, with the interval of Welch's test."""
    middle = 0.5 * (left.mean() + right.mean())
    parts = [each.var(ddof=1) / len(each) for each in (left, right)]
    error = float(np.sqrt(sum(parts)))
    spread = sum(part**2 / (len(each) - 1) for part, each in zip(parts, (left, right), strict=True))
    freedom = sum(parts) ** 2 / spread if spread > 0 else 1.0
    value, scale = 100.0 * float(right.mean() - left.mean()) / middle, 100.0 / abs(middle)
    half = float(stdtrit(freedom, 0.975)) * error * scale
    stem = name.rsplit("_", 1)[0]
    n = min(len(left), len(right))
    return GaitParameter(f"{stem}_asymmetry_percent", "both", value, error * scale, n, value - half, value + half)


def mean_of(parameters: Iterable[GaitParameter], name: str, side: str = "both") -> GaitParameter | None:
    """Return a parameter of one side or of both, or None without it."""
    return next((each for each in parameters if each.name == name and each.side == side), None)
