"""Heel strikes and toe-offs of walking and running.

Two methods find them: changes of foot contact, and the extremes of the feet along the facing direction relative to the
pelvis (Zeni et al. 2008, Gait & Posture 27(4)). The extremes decide what is a step; the time is the mean of both
methods, weighted by their variances, after the median lag of the extremes has been subtracted. Steps count only in
bouts of alternating feet.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from posefuse.biomechanics.contact_times import Interval
from posefuse.biomechanics.foot_paths import HEEL, TOES, FootPaths

_MIN_EXCURSION = 0.12
"""Smallest excursion of a foot along the facing direction, as a share of the length of the leg."""
_MATCH_S = 0.16
"""Largest difference of the two methods for one event, after the lag."""
_SAME_S = 0.03
"""Difference of the two methods at which the confidence has fallen to 0.8."""
_STEP_S = (0.15, 1.6)
"""Shortest and longest step."""
_MIN_STEPS = 4
"""Heel strikes of alternating feet that make a bout."""
_UNUSUAL = 0.5
"""Relative difference from the median duration of a bout and side, above which a step or stride contains a pause or a
missed step."""
_MERGE_S = 0.05
_SMOOTHING_S = 0.02


@dataclass(frozen=True)
class GaitEvent:
    """A heel strike or a toe-off.

    Attributes:
        kind: ``heel_strike`` or ``toe_off``.
        side: 0 for left, 1 for right.
        time_s: time.
        sd_s: standard deviation of the time.
        confidence: agreement of the two methods: 1 for equal times, 0.5 if only one found the event.
        bout: number of the bout, from 0.
        closing: whether the foot only joins the other one at the end of a bout; such a strike ends no step or stride.
    """

    kind: str
    side: int
    time_s: float
    sd_s: float
    confidence: float
    bout: int
    closing: bool = False

    @property
    def agreed(self) -> bool:
        """Whether both methods found the event."""
        return self.confidence > 0.5


def gait_events(paths: FootPaths, contacts: list[list[list[Interval]]]) -> list[GaitEvent]:
    """Return the heel strikes and toe-offs of all bouts in the order of time.

    Args:
        paths: paths of the person.
        contacts: contact intervals by side and part.
    """
    if len(paths.time_s) < 8:
        return []
    strikes, offs = [], []
    feet = [foot_stances(parts) for parts in contacts]
    for side, stances in enumerate(feet):
        ahead, behind = _extremes(paths, side)
        strikes += _combined("heel_strike", side, ahead, [(s.start_s, s.start_sd_s) for s in stances], paths.time_s)
        offs += _combined("toe_off", side, behind, [(s.end_s, s.end_sd_s) for s in stances], paths.time_s)
    bouts = _bouts(sorted(strikes, key=lambda event: event.time_s))
    bouts = [[*bout, *_closing_strike(bout, feet)] for bout in bouts]
    offs += [off for bout in bouts for off in _first_offs(bout, offs, feet)]
    events = [_in_bout(event, number) for number, bout in enumerate(bouts) for event in bout]
    for number, bout in enumerate(bouts):
        first, last = bout[0].time_s - _STEP_S[1], bout[-1].time_s + 0.5 * _STEP_S[1]
        events += [_in_bout(off, number) for off in offs if _belongs(off, bout, first, last)]
    return sorted(events, key=lambda event: event.time_s)


def foot_stances(parts: list[list[Interval]]) -> list[Interval]:
    """Return the intervals in which the heel or the toes touch."""
    merged: list[Interval] = []
    for each in sorted([*parts[HEEL], *parts[TOES]], key=lambda interval: interval.start_s):
        if merged and each.start_s <= merged[-1].end_s + _MERGE_S:
            last = merged[-1]
            if each.end_s > last.end_s:
                merged[-1] = Interval(last.start_s, each.end_s, last.start_sd_s, each.end_sd_s)
        else:
            merged.append(each)
    return merged


def facing(paths: FootPaths) -> np.ndarray:
    """Return the horizontal unit vector that points forward from the hips, shape (frame, 2), NaN without hips."""
    left = paths.hips_m[:, 0, :2] - paths.hips_m[:, 1, :2]
    forward = np.stack([left[:, 1], -left[:, 0]], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return forward / np.linalg.norm(forward, axis=1, keepdims=True)


def leg_length(paths: FootPaths) -> float:
    """Return the usual largest distance from hip to heel in meters, NaN without points."""
    extension = np.linalg.norm(paths.hips_m - paths.feet_m[:, :, HEEL], axis=-1)
    known = extension[np.isfinite(extension)]
    return float(np.quantile(known, 0.95)) if len(known) else float("nan")


def _extremes(paths: FootPaths, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the times at which the heel is farthest ahead, and the toes farthest behind."""
    from scipy.signal import find_peaks  # Takes half a second to load, and many results have no feet.

    forward, pelvis = facing(paths), paths.pelvis_m[:, :2]
    period = float(np.median(np.diff(paths.time_s)))
    least = _MIN_EXCURSION * leg_length(paths)
    found = []
    for part, sign in ((HEEL, 1.0), (TOES, -1.0)):
        along = sign * ((paths.feet_m[:, side, part, :2] - pelvis) * forward).sum(axis=1)
        known = np.isfinite(along)
        if known.sum() < 8 or not np.isfinite(least):
            found.append(np.empty(0))
            continue
        filled = np.interp(paths.time_s, paths.time_s[known], along[known])
        smooth = gaussian_filter1d(filled, max(_SMOOTHING_S / period, 1e-3))
        peaks = find_peaks(smooth, prominence=least)[0]
        peaks = peaks[known[peaks]]
        found.append(np.array([_vertex(paths.time_s, smooth, int(peak)) for peak in peaks]))
    return found[0], found[1]


def _vertex(time_s: np.ndarray, values: np.ndarray, peak: int) -> float:
    """Return the time of the parabola through a peak and its neighbors."""
    below, top, above = values[peak - 1], values[peak], values[peak + 1]
    bend = below - 2.0 * top + above
    shift = 0.5 * (below - above) / bend if bend < 0 else 0.0
    return float(time_s[peak] + shift * 0.5 * (time_s[peak + 1] - time_s[peak - 1]))


def _combined(
    kind: str, side: int, extremes_s: np.ndarray, changes: list[tuple[float, float]], time_s: np.ndarray
) -> list[GaitEvent]:
    """Return an event for every extreme, combined with the change of contact next to it."""
    known = [(time, sd) for time, sd in changes if np.isfinite(time)]
    period = float(np.median(np.diff(time_s)))
    matches = [min(known, key=lambda each: abs(each[0] - t), default=(np.inf, np.nan)) for t in extremes_s]
    lags = np.array([time - t for (time, _), t in zip(matches, extremes_s, strict=True) if abs(time - t) < _MATCH_S])
    lag = float(np.median(lags)) if len(lags) else 0.0
    spread = 1.4826 * float(np.median(np.abs(lags - lag))) if len(lags) > 2 else 2.0 * period
    usual = float(np.median([sd**2 for time, sd in matches if np.isfinite(time)])) if len(lags) else 0.0
    own = max(spread**2 - usual, period**2)
    events = []
    for t, (time, sd) in zip(extremes_s, matches, strict=True):
        apart = time - t - lag
        if abs(apart) > _MATCH_S:
            events.append(GaitEvent(kind, side, float(t + lag), float(np.sqrt(own)), 0.5, 0))
            continue
        share = own / (own + sd**2)
        confidence = 0.5 + 0.5 * float(np.exp(-0.5 * (apart / _SAME_S) ** 2))
        mean, sd_s = share * time + (1.0 - share) * (t + lag), float(np.sqrt(own * sd**2 / (own + sd**2)))
        events.append(GaitEvent(kind, side, float(mean), sd_s, confidence, 0))
    return events


def _bouts(strikes: list[GaitEvent]) -> list[list[GaitEvent]]:
    """Return runs of heel strikes of alternating feet that are at least as long as a bout."""
    runs: list[list[GaitEvent]] = []
    for event in strikes:
        last = runs[-1][-1] if runs else None
        if last is not None and last.side != event.side and _STEP_S[0] <= event.time_s - last.time_s <= _STEP_S[1]:
            runs[-1].append(event)
        else:
            runs.append([event])
    return [run for run in runs if len(run) >= _MIN_STEPS and _is_regular(run)]


def _is_regular(run: list[GaitEvent]) -> bool:
    """Return whether most strikes are found by both methods and the strides have similar durations."""
    strides = np.array([later.time_s - earlier.time_s for earlier, later in zip(run, run[2:], strict=False)])
    both = np.mean([event.confidence > 0.5 for event in run])
    middle = np.median(strides)
    return bool(both >= 0.5 and np.median(np.abs(strides - middle)) < 0.2 * middle)


def _closing_strike(bout: list[GaitEvent], feet: list[list[Interval]]) -> list[GaitEvent]:
    """Return the strike that ends a bout beside the other foot, which contact alone shows."""
    last, side = bout[-1], 1 - bout[-1].side
    later = [each for each in feet[side] if _STEP_S[0] < each.start_s - last.time_s < _STEP_S[1]]
    return [GaitEvent("heel_strike", side, each.start_s, each.start_sd_s, 0.5, 0, closing=True) for each in later[:1]]


def _first_offs(bout: list[GaitEvent], offs: list[GaitEvent], feet: list[list[Interval]]) -> list[GaitEvent]:
    """Return the toe-offs before the first strike of each foot that contact alone shows."""
    found = []
    for side in (0, 1):
        strike = next((each.time_s for each in bout if each.side == side), None)
        if strike is None or any(off.side == side and 0 < strike - off.time_s < _STEP_S[1] for off in offs):
            continue
        earlier = [each for each in feet[side] if 0.1 < strike - each.end_s < _STEP_S[1]]
        found += [GaitEvent("toe_off", side, each.end_s, each.end_sd_s, 0.5, 0) for each in earlier[-1:]]
    return found


def _belongs(off: GaitEvent, bout: list[GaitEvent], first: float, last: float) -> bool:
    """Return whether a toe-off belongs to a bout: a strike of the same foot follows or precedes it."""
    if not first <= off.time_s <= last:
        return False
    own = [strike.time_s for strike in bout if strike.side == off.side]
    return any(-1.2 < off.time_s - time < 2.0 * _STEP_S[1] for time in own)


def _in_bout(event: GaitEvent, bout: int) -> GaitEvent:
    return replace(event, bout=bout)


def strides_of(events: list[GaitEvent]) -> list[tuple[GaitEvent, GaitEvent]]:
    """Return pairs of consecutive heel strikes of the same foot in a bout that both methods found, in order of time."""
    found = []
    for side in (0, 1):
        found += [pair for pair in pairwise(_strikes(events, side)) if pair[1].time_s - pair[0].time_s < 2 * _STEP_S[1]]
    return _usual(found)


def steps_of(events: list[GaitEvent]) -> list[tuple[GaitEvent, GaitEvent]]:
    """Return pairs of consecutive heel strikes of both feet in a bout that both methods found, in order of time."""
    return _usual([(before, strike) for before, strike in pairwise(_strikes(events)) if before.side != strike.side])


def _strikes(events: list[GaitEvent], side: int | None = None) -> list[GaitEvent]:
    """Return the heel strikes of a foot or of both that end a step or stride."""
    return [
        event for event in events if event.kind == "heel_strike" and not event.closing and side in (None, event.side)
    ]


def _usual(pairs: list[tuple[GaitEvent, GaitEvent]]) -> list[tuple[GaitEvent, GaitEvent]]:
    """Return the pairs within bouts whose strikes both methods found and that contain no pause or missed step.

    Args:
        pairs: consecutive strikes. A strike that only one method found separates its neighbors, which are no pair.
    """
    durations: dict[tuple[int, int], list[float]] = {}
    pairs = [(a, b) for a, b in pairs if a.bout == b.bout and a.agreed and b.agreed]
    for a, b in pairs:
        durations.setdefault((b.bout, b.side), []).append(b.time_s - a.time_s)
    middles = {key: float(np.median(each)) for key, each in durations.items()}
    usual = [(a, b) for a, b in pairs if _is_usual(b.time_s - a.time_s, middles[b.bout, b.side])]
    return sorted(usual, key=lambda pair: pair[0].time_s)


def _is_usual(duration_s: float, middle_s: float) -> bool:
    return abs(duration_s - middle_s) <= _UNUSUAL * middle_s
