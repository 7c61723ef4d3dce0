"""Gaps: found, and filled where they are short, never beyond a keypoint's first and last point."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import PchipInterpolator

from posefuse.model.options.postprocess import PostprocessOptions
from posefuse.model.status import Source
from posefuse.postprocess.kalman import smoothed
from posefuse.postprocess.points import Clock, Points

_EDGE = 1e-6


def fill(points: Points, clock: Clock, options: PostprocessOptions) -> Points:
    """Put points into short gaps.

    What lies between measured points nobody saw: lines and cubics know no covariance (NaN); the smoother says how far
    a point may have strayed.

    Args:
        points: with gaps.
        clock: of their frames.
        options: how, and up to which length.
    """
    short = short_gaps(points.known, clock, options.max_gap_s)
    if options.fill == "none" or not short.any():
        return points
    covariance = np.where(short[..., None], np.nan, points.covariance_m2)
    if options.fill == "smoother":
        expected = smoothed(points, clock, options.kalman)
        xyz, covariance = expected.xyz_m, np.where(short[..., None], expected.covariance_m2, covariance)
    else:
        xyz = _interpolated(points.xyz_m, short, clock, cubic=options.fill == "pchip")
    return Points(
        np.where(short[..., None], xyz, points.xyz_m),
        covariance,
        np.where(short, Source.FILLED, points.source).astype(np.int8),
    )


def short_gaps(known: np.ndarray, clock: Clock, max_gap_s: float) -> np.ndarray:
    """Shape (frame, point), bool: missing points between known ones that are missing for no longer than that.

    A point is missing from a period after the last known one to the next.
    """
    short = np.zeros_like(known)
    for p in range(known.shape[1]):
        for start, stop in _gaps(known[:, p]):
            missing_s = clock.time_s[stop] - clock.time_s[start - 1] - clock.period_s
            short[start:stop, p] = missing_s <= max_gap_s + _EDGE * clock.period_s
    return short & np.isfinite(clock.time_s)[:, None]


def _gaps(known: np.ndarray) -> Iterator[tuple[int, int]]:
    """Ranges of frames in which one point is missing, but for those before its first and after its last."""
    there = np.flatnonzero(known)
    for before, after in pairwise(there.tolist()):
        if after > before + 1:
            yield before + 1, after


def _interpolated(xyz_m: np.ndarray, wanted: np.ndarray, clock: Clock, *, cubic: bool) -> np.ndarray:
    """Shape (frame, point, 3): positions at the wanted places from the known ones around, elsewhere as they were."""
    out = xyz_m.copy()
    for p in np.flatnonzero(wanted.any(axis=0)):
        here = wanted[:, p]
        known = np.isfinite(xyz_m[:, p, 0]) & np.isfinite(clock.time_s)
        time_s, at_s, values = clock.time_s[known], clock.time_s[here], xyz_m[known, p]
        if cubic:
            out[here, p] = PchipInterpolator(time_s, values, axis=0)(at_s)
        else:
            out[here, p] = np.stack([np.interp(at_s, time_s, values[:, axis]) for axis in range(3)], axis=-1)
    return out


def drop(points: Points, unreliable: np.ndarray) -> Points:
    """Take points out.

    Args:
        points: with unreliable ones among them.
        unreliable: shape (frame, point), bool.
    """
    return replace(
        points,
        xyz_m=np.where(unreliable[..., None], np.nan, points.xyz_m),
        covariance_m2=np.where(unreliable[..., None], np.nan, points.covariance_m2),
        source=np.where(unreliable, Source.NONE, points.source).astype(np.int8),
    )
