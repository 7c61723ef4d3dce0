"""Wrong frame rates: views whose timestamps run at another rate than the motion in the other views."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posefuse.calibration.people.bearings import Bearings
from posefuse.calibration.people.time_search import GRID_S, affine_curve

_RATIOS = (1.0, 24 / 25, 25 / 24, 25 / 30, 30 / 25, 24 / 30, 30 / 24, 1 / 2, 2.0, 1 / 4, 4.0)
"""Ratios of the usual frame rates 24, 25, 30, 50, 60 and 120 Hz."""
_MIN_SHIFT_S = 0.3
_MIN_GAIN = 0.75


def at_rate(view: Bearings, rate: float) -> Bearings:
    """Return a view whose timestamps run at another rate from its first one on."""
    return replace(view, time_s=view.time_s[0] + rate * (view.time_s - view.time_s[0]))


def rig_rates(views: Sequence[Bearings], people: Sequence[Sequence[int]], max_offset_s: float = 2.0) -> np.ndarray:
    """Return true seconds per second of the timestamps, relative to the first view, shape (view,).

    A ratio of usual frame rates replaces 1 where the motion agrees clearly better with the view that has most
    detections. Views start at the same time but for bounded time offsets.

    Args:
        views: directions of all views.
        people: index of each person in every view, -1 where a view does not observe it.
        max_offset_s: bound of the time offsets.
    """
    reference = int(np.argmax([np.isfinite(view.sigma).sum() for view in views]))
    rates = np.ones(len(views))
    for v in range(len(views)):
        shared = tuple((p[reference], p[v]) for p in people if p[reference] >= 0 and p[v] >= 0)
        if v != reference and shared:
            rates[v] = _best_ratio(views[reference], views[v], shared, max_offset_s)
    return rates / rates[0]


def _best_ratio(a: Bearings, b: Bearings, people: tuple[tuple[int, int], ...], max_offset_s: float) -> float:
    grid = np.arange(-max_offset_s, max_offset_s + 0.5 * GRID_S, GRID_S)
    span_s = float(np.ptp(b.time_s))
    costs = {}
    for ratio in _RATIOS:
        if ratio == 1.0 or abs(ratio - 1.0) * span_s > _MIN_SHIFT_S:
            curve = affine_curve(a, at_rate(b, ratio), people, grid, 1.0)
            if np.isfinite(curve).any():
                costs[ratio] = float(np.nanmin(curve))
    best = min(costs, key=lambda ratio: costs[ratio], default=1.0)
    return best if costs and costs[best] < _MIN_GAIN * costs.get(1.0, np.inf) else 1.0
