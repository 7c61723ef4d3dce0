"""Gait cycles of each foot, from heel strike to heel strike, on a common scale from 0 to 100 %."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posefuse.biomechanics.floor_levels import Levels
from posefuse.biomechanics.foot_paths import HEEL, SIDES, TOES, FootPaths
from posefuse.biomechanics.gait_events import GaitEvent, leg_length, strides_of

PERCENT = np.arange(101)
_HEADING = "pelvis_rotation"
"""The angle that is relative to the world, and in cycles relative to the direction of walking."""
_MIN_ADVANCE = 0.25
"""Shortest distance that the pelvis covers in a stride that has a direction, as a share of the length of the leg."""


@dataclass(frozen=True, eq=False)
class Cycle:
    """Mean course of one signal over the gait cycle.

    Attributes:
        side: ``left`` or ``right``.
        signal: name of the signal with its unit as suffix.
        mean: shape (101,): mean over cycles from 0 to 100 %.
        sd: shape (101,): standard deviation over cycles, NaN for a single one.
        n: shape (101,): number of cycles.
    """

    side: str
    signal: str
    mean: np.ndarray
    sd: np.ndarray
    n: np.ndarray


def gait_cycles(
    paths: FootPaths,
    events: list[GaitEvent],
    levels: Levels,
    angles_deg: Mapping[str, np.ndarray],
    ground_m_s: np.ndarray,
) -> list[Cycle]:
    """Return the cycles of the heights of heel and toes above the level, of the flexion of the knee, and of angles.

    Angles have no jumps between -180 and 180 degrees: the cycles of an angle are on the same branch. The rotation of
    the pelvis is relative to the direction of walking, left positive; steps on the spot have none.

    Args:
        paths: paths of the person.
        events: heel strikes and toe-offs.
        levels: levels on which feet rest.
        angles_deg: joint angles by name, shape (frame, side), between -180 and 180 degrees.
        ground_m_s: shape (2,): velocity of a treadmill's belt, zero overground.
    """
    heights = levels.nearest_height(paths.feet_m)
    found = []
    for side, name in enumerate(SIDES):
        signals = {
            "heel_height_m": heights[:, side, HEEL],
            "toe_height_m": heights[:, side, TOES],
            "knee_flexion_deg": paths.knee_deg[:, side],
        }
        strides = [(a.time_s, b.time_s) for a, b in strides_of(events) if a.side == side]
        rows = {signal: _rows(paths.time_s, values, strides) for signal, values in signals.items()}
        for angle, values in angles_deg.items():
            turned = _rows(paths.time_s, _unwrapped(values[:, side]), strides)
            if angle == _HEADING:
                turned = turned - _directions_deg(paths, strides, ground_m_s)
            rows[f"{angle}_deg"] = _on_one_branch(turned)
        found += [_mean_cycle(name, signal, each) for signal, each in rows.items() if np.isfinite(each).any()]
    return found


def _rows(time_s: np.ndarray, values: np.ndarray, strides: list[tuple[float, float]]) -> np.ndarray:
    """Return a signal in every stride, shape (stride, 101)."""
    return np.array([_normalized(time_s, values, *stride) for stride in strides]).reshape(-1, len(PERCENT))


def _unwrapped(degrees: np.ndarray) -> np.ndarray:
    """Return an angle without jumps between -180 and 180 degrees, so that it can be interpolated."""
    known = np.isfinite(degrees)
    smooth = np.full(degrees.shape, np.nan)
    smooth[known] = np.unwrap(degrees[known], period=360.0)
    return smooth


def _on_one_branch(rows: np.ndarray) -> np.ndarray:
    """Return cycles of an angle, moved by whole turns next to the circular mean of all.

    Args:
        rows: shape (stride, 101), in degrees.
    """
    rows = np.array([_unwrapped(row) for row in rows]).reshape(rows.shape)
    known = np.isfinite(rows)
    middles = np.where(known, rows, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    around = np.exp(1j * np.radians(middles[known.any(axis=1)])).sum()
    return rows - 360.0 * np.round((middles - np.degrees(np.angle(around))) / 360.0)[:, None]


def _directions_deg(paths: FootPaths, strides: list[tuple[float, float]], ground_m_s: np.ndarray) -> np.ndarray:
    """Return the direction of walking at 0 to 100 % of every stride, shape (stride, 101).

    It is that in which the pelvis moves on the ground from half a stride before to half a stride after, which contains
    neither its sway nor the turn of a curved path, as the angle to the left of the first horizontal axis; NaN on the
    spot.
    """
    pelvis = paths.pelvis_m[:, :2]
    known = np.isfinite(pelvis[:, 0])
    if not strides or not known.any():
        return np.full((len(strides), len(PERCENT)), np.nan)
    start_s, end_s = np.array(strides).T[..., None, None]
    duration_s = end_s - start_s
    middle_s = start_s + duration_s * PERCENT[:, None] / 100.0
    # Shape (stride, 101, 2); at the ends of the recording, an interval is shorter.
    at_s = np.clip(middle_s + duration_s * np.array([-0.5, 0.5]), *paths.time_s[known][[0, -1]])
    places = np.stack([np.interp(at_s, paths.time_s[known], each) for each in pelvis[known].T], axis=-1)
    advance = np.diff(places - at_s[..., None] * ground_m_s, axis=2)[:, :, 0]
    far = np.linalg.norm(advance, axis=-1) > _MIN_ADVANCE * leg_length(paths)
    return np.where(far, np.degrees(np.arctan2(advance[..., 1], advance[..., 0])), np.nan)


def _normalized(time_s: np.ndarray, values: np.ndarray, start_s: float, end_s: float) -> np.ndarray:
    """Return a signal at 0 to 100 % of a cycle, shape (101,), NaN within and beside missing frames."""
    return np.interp(start_s + (end_s - start_s) * PERCENT / 100.0, time_s, values, left=np.nan, right=np.nan)


def _mean_cycle(side: str, signal: str, rows: np.ndarray) -> Cycle:
    n = np.isfinite(rows).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(n > 0, np.nansum(rows, axis=0) / n, np.nan)
        sd = np.where(n > 1, np.sqrt(np.nansum(np.square(rows - mean), axis=0) / (n - 1)), np.nan)
    return Cycle(side, signal, mean, sd, n)
