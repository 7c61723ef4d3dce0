"""Jumps, squats and sit-to-stand, from contact and the height of the pelvis."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from posefuse.biomechanics.contact_times import Interval
from posefuse.biomechanics.foot_paths import FootPaths
from posefuse.biomechanics.gait_events import GaitEvent, foot_stances, leg_length

_GRAVITY = 9.81
_FLIGHT_S = (0.1, 1.2)
_RISE_SHARE = 0.4
"""Smallest rise of the pelvis in a jump, as a share of the rise that its flight time implies."""
_MIN_DEPTH = 0.15
"""Smallest depth of a squat as a share of the length of the leg."""
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
        flight = land_s - off_s
        if not _FLIGHT_S[0] < flight < _FLIGHT_S[1]:
            continue
        rise = _GRAVITY * flight**2 / 8.0
        top, off, land = np.interp([0.5 * (off_s + land_s), off_s, land_s], paths.time_s, height)
        if top - 0.5 * (off + land) > _RISE_SHARE * rise:
            sd = _GRAVITY * flight / 4.0 * float(np.hypot(off_sd, land_sd))
            found.append(Repetition("jump", off_s, land_s, rise, sd))
    return found


def _lowerings(paths: FootPaths, height: np.ndarray, jumps: list[Repetition]) -> list[Repetition]:
    """Return squats and sit-to-stands: the pelvis sinks between two standing positions."""
    feet = np.nanmin(paths.feet_m[..., 2].reshape(len(height), -1), axis=1, initial=np.inf)
    above = height - np.where(np.isfinite(feet), feet, np.nan)
    above = np.where(np.isfinite(above), above, np.nanmedian(above)) if np.isfinite(above).any() else height
    leg = leg_length(paths)
    standing = float(np.quantile(above, 0.9))
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
        bottom = np.flatnonzero(above[first : last + 1] < standing - (1.0 - _NEAR_BOTTOM) * depth) + first
        seated = float(paths.time_s[bottom[-1]] - paths.time_s[bottom[0]])
        if seated > _SITTING_S:
            found.append(Repetition("sit_to_stand", float(paths.time_s[bottom[-1]]), end, depth, float("nan")))
        else:
            found.append(Repetition("squat", start, end, depth, float("nan")))
    return found
