"""Jumps, squats and sit-to-stand, from contact and the height of the pelvis."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from posefuse.biomechanics.contact_times import PERIOD_DOUBT, Interval, weighted_minimum
from posefuse.biomechanics.foot_paths import TOES, FootPaths
from posefuse.biomechanics.gait_events import GaitEvent, foot_stances, leg_length

_GRAVITY = 9.81
_FLIGHT_S = (0.1, 1.2)
_RISE_SHARE = 0.4
"""Smallest rise of the pelvis in a jump, as a share of the rise that its flight time implies."""
_EDGE_SEARCH_S, _EDGE_REST_S = 0.15, 0.15
_EDGE_CANDIDATES = 61
_MIN_DEPTH = 0.15
"""Smallest depth of a squat as a share of the length of the leg."""
_STRAIGHT_DEG, _UPRIGHT = 45.0, 0.75
"""Largest flexion of the straighter knee, and smallest height of the pelvis above the lower foot as a share of the
length of the leg, of a person who stands. The leg is then at least 0.92 of its length."""
_STANDING_S, _STANDING_SHARE = 0.5, 0.2
"""Interval before and after a squat, and the share of it in which the person stands."""
_DURATION_S = (0.5, 60.0)
_SITTING_S = 1.0
"""Time near the lowest position from which a lowering counts as sitting."""
_NEAR_BOTTOM = 0.15
_SMOOTHING_S = 0.08


@dataclass(frozen=True)
class Repetition:
    """One jump, squat, or sit-to-stand.

    Attributes:
        kind: ``jump``, ``squat`` or ``sit_to_stand``.
        start_s: toe-off of a jump; start of the descent of a squat; start of rising from a seat.
        end_s: landing; end of rising.
        size_m: height of a jump from its flight time; depth of a squat; rise of the pelvis from a seat.
        sd_m: standard deviation of the size, NaN if unknown.
    """

    kind: str
    start_s: float
    end_s: float
    size_m: float
    sd_m: float

    @property
    def duration_s(self) -> float:
        """Duration: flight time of a jump."""
        return self.end_s - self.start_s


def find_repetitions(
    paths: FootPaths, contacts: list[list[list[Interval]]], events: list[GaitEvent]
) -> list[Repetition]:
    """Return all repetitions outside of bouts of gait, in the order of time.

    Args:
        paths: paths of the person.
        contacts: contact intervals by side and part.
        events: gait events.
    """
    if len(paths.time_s) < 8 or not np.isfinite(leg_length(paths)):
        return []
    height = _pelvis_height(paths)
    found = _jumps(paths, height, [foot_stances(parts) for parts in contacts])
    found += _lowerings(paths, height, found)
    bouts = {event.bout for event in events}
    spans = [[event.time_s for event in events if event.bout == bout] for bout in bouts]
    walked = [(min(times), max(times)) for times in spans]
    free = [each for each in found if not any(a < each.end_s and each.start_s < b for a, b in walked)]
    return sorted(free, key=lambda each: each.start_s)


def _pelvis_height(paths: FootPaths) -> np.ndarray:
    """Return the smoothed height of the pelvis, shape (frame,), interpolated over missing frames."""
    height = paths.pelvis_m[:, 2]
    known = np.isfinite(height)
    if known.sum() < 4:
        return np.full(len(height), np.nan)
    filled = np.interp(paths.time_s, paths.time_s[known], height[known])
    period = float(np.median(np.diff(paths.time_s)))
    return gaussian_filter1d(filled, _SMOOTHING_S / period)


def _jumps(paths: FootPaths, height: np.ndarray, stances: list[list[Interval]]) -> list[Repetition]:
    """Return the intervals in which no foot touches and the pelvis rises as in a flight."""
    found = []
    left, right = stances
    for before in left:
        partner = min(right, key=lambda each: abs(each.end_s - before.end_s), default=None)
        if partner is None or not abs(partner.end_s - before.end_s) < 0.2:
            continue
        off_s, off_sd = max((before.end_s, before.end_sd_s), (partner.end_s, partner.end_sd_s))
        landings = [(each.start_s, each.start_sd_s) for side in stances for each in side if each.start_s > off_s]
        land_s, land_sd = min(landings, default=(np.inf, np.nan))
        if _FLIGHT_S[0] < land_s - off_s < 1.5 * _FLIGHT_S[1]:
            middle = 0.5 * (off_s + land_s)
            (off_s, off_sd), (land_s, land_sd) = _takeoff(paths, off_s, middle), _landing(paths, land_s, middle)
        flight = land_s - off_s
        if not _FLIGHT_S[0] < flight < _FLIGHT_S[1]:
            continue
        rise = _GRAVITY * flight**2 / 8.0
        top, off, land = np.interp([0.5 * (off_s + land_s), off_s, land_s], paths.time_s, height)
        if top - 0.5 * (off + land) > _RISE_SHARE * rise:
            sd = _GRAVITY * flight / 4.0 * float(np.hypot(off_sd, land_sd))
            found.append(Repetition("jump", off_s, land_s, rise, sd))
    return found


def _takeoff(paths: FootPaths, guess_s: float, middle_s: float) -> tuple[float, float]:
    """Return the time at which the toes begin to fly, and its standard deviation.

    Their height is constant before, then a parabola of free fall. Contact is less exact here: paths that
    move smoothly blur the sudden change of speed.

    Args:
        paths: paths of the person.
        guess_s: approximate time.
        middle_s: middle of the flight.
    """
    return _flight_edge(paths.time_s - guess_s, paths.feet_m[:, :, TOES, 2], guess_s, middle_s - guess_s)


def _landing(paths: FootPaths, guess_s: float, middle_s: float) -> tuple[float, float]:
    """Return the time at which the toes land, and its standard deviation: the time-reversed :func:`_takeoff`."""
    back, sd_s = _flight_edge(guess_s - paths.time_s[::-1], paths.feet_m[::-1, :, TOES, 2], 0.0, guess_s - middle_s)
    return guess_s - back, sd_s


def _flight_edge(since_s: np.ndarray, heights_m: np.ndarray, origin_s: float, until_s: float) -> tuple[float, float]:
    """Return ``origin_s`` plus the time since it at which free fall begins, and its standard deviation.

    Args:
        since_s: shape (frame,): time since the approximate beginning.
        heights_m: shape (frame, foot).
        origin_s: approximate beginning.
        until_s: time until which the feet fly.
    """
    near = (since_s > -_EDGE_SEARCH_S - _EDGE_REST_S) & (since_s < until_s)
    tau, height = since_s[near], heights_m[near]
    height = height[:, np.isfinite(height).all(axis=0)]
    if len(tau) < 8 or not height.size:
        return origin_s, float("nan")
    shifts = np.linspace(-_EDGE_SEARCH_S, min(_EDGE_SEARCH_S, 0.5 * until_s), _EDGE_CANDIDATES)
    costs = []
    for shift in shifts:
        moving = np.maximum(tau - shift, 0.0)
        fallen = height + 0.5 * _GRAVITY * np.square(moving)[:, None]
        design = np.stack([np.ones(len(tau)), moving], axis=1)
        costs.append(np.square(fallen - design @ np.linalg.lstsq(design, fallen, rcond=None)[0]).sum())
    mean, sd = weighted_minimum(shifts, np.array(costs), max(1, height.size - 5))
    return origin_s + mean, float(np.hypot(sd, float(np.median(np.diff(tau))) * PERIOD_DOUBT))


def _lowerings(paths: FootPaths, height: np.ndarray, jumps: list[Repetition]) -> list[Repetition]:
    """Return squats and sit-to-stands: the pelvis sinks, and the person stands before and after, or after it."""
    feet = np.nanmin(paths.feet_m[..., 2].reshape(len(height), -1), axis=1, initial=np.inf)
    above = height - np.where(np.isfinite(feet), feet, np.nan)
    known = paths.leg_m[np.isfinite(paths.leg_m)]
    leg = float(np.median(known)) if len(known) else float("nan")
    stands = _stands(paths, above, leg)
    if not stands.any():
        return []
    standing = float(np.median(above[stands]))
    above = np.where(np.isfinite(above), above, np.nanmedian(above))
    low = above < standing - 0.5 * _MIN_DEPTH * leg
    edges = np.flatnonzero(np.diff(low.astype(np.int8)))
    found = []
    for first, last in pairwise(edges):
        if low[first] or not low[first + 1]:
            continue
        start, end = float(paths.time_s[first]), float(paths.time_s[last])
        depth = standing - float(np.quantile(above[first : last + 1], 0.1))
        near_jump = any(start < jump.end_s + 1.0 and end > jump.start_s - 1.0 for jump in jumps)
        if depth < _MIN_DEPTH * leg or near_jump or not _DURATION_S[0] <= end - start <= _DURATION_S[1]:
            continue
        if not _stands_during(paths, stands, end, end + _STANDING_S):
            continue
        bottom = np.flatnonzero(above[first : last + 1] < standing - (1.0 - _NEAR_BOTTOM) * depth) + first
        seated = float(paths.time_s[bottom[-1]] - paths.time_s[bottom[0]])
        if seated > _SITTING_S:
            found.append(Repetition("sit_to_stand", float(paths.time_s[bottom[-1]]), end, depth, float("nan")))
        elif _stands_during(paths, stands, start - _STANDING_S, start):
            found.append(Repetition("squat", start, end, depth, float("nan")))
    return found


def _stands(paths: FootPaths, above_m: np.ndarray, leg_m: float) -> np.ndarray:
    """Return whether the person stands, shape (frame,): a knee is about straight and the pelvis is high.

    Args:
        paths: paths of the person.
        above_m: shape (frame,): height of the pelvis above the lower foot.
        leg_m: length of thigh and shank, NaN if unknown; then nothing shows that a person stands.
    """
    straighter = np.nanmin(paths.knee_deg, axis=1, initial=np.inf)
    return np.asarray((straighter < _STRAIGHT_DEG) & (above_m > _UPRIGHT * leg_m))


def _stands_during(paths: FootPaths, stands: np.ndarray, first_s: float, last_s: float) -> bool:
    """Return whether the person stands in a part of an interval."""
    inside = (paths.time_s >= first_s) & (paths.time_s <= last_s)
    return bool(stands[inside].mean() >= _STANDING_SHARE) if inside.any() else False
