"""Gait cycles of each foot, from heel strike to heel strike, on a common scale from 0 to 100 %."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posefuse.biomechanics.floor_levels import Levels
from posefuse.biomechanics.foot_paths import HEEL, SIDES, TOES, FootPaths
from posefuse.biomechanics.gait_events import GaitEvent, strides_of

PERCENT = np.arange(101)


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
    paths: FootPaths, events: list[GaitEvent], levels: Levels, angles_deg: Mapping[str, np.ndarray]
) -> list[Cycle]:
    """Return the cycles of the heights of heel and toes above the level, of the flexion of the knee, and of angles.

    Args:
        paths: paths of the person.
        events: heel strikes and toe-offs.
        levels: levels on which feet rest.
        angles_deg: joint angles by name, shape (frame, side).
    """
    heights = levels.nearest_height(paths.feet_m)
    found = []
    for side, name in enumerate(SIDES):
        signals = {
            "heel_height_m": heights[:, side, HEEL],
            "toe_height_m": heights[:, side, TOES],
            "knee_flexion_deg": paths.knee_deg[:, side],
            **{f"{angle}_deg": values[:, side] for angle, values in angles_deg.items()},
        }
        strides = [(a.time_s, b.time_s) for a, b in strides_of(events) if a.side == side]
        for signal, values in signals.items():
            rows = np.array([_normalized(paths.time_s, values, *stride) for stride in strides])
            if len(rows) and np.isfinite(rows).any():
                found.append(_mean_cycle(name, signal, rows))
    return found


def _normalized(time_s: np.ndarray, values: np.ndarray, start_s: float, end_s: float) -> np.ndarray:
    """Return a signal at 0 to 100 % of a cycle, shape (101,), NaN within and beside missing frames."""
    return np.interp(start_s + (end_s - start_s) * PERCENT / 100.0, time_s, values, left=np.nan, right=np.nan)


def _mean_cycle(side: str, signal: str, rows: np.ndarray) -> Cycle:
    n = np.isfinite(rows).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(n > 0, np.nansum(rows, axis=0) / n, np.nan)
        sd = np.where(n > 1, np.sqrt(np.nansum(np.square(rows - mean), axis=0) / (n - 1)), np.nan)
    return Cycle(side, signal, mean, sd, n)
