"""Find gaps and fill short ones, never before a keypoint's first or after its last point."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import PchipInterpolator

from posefuse.model.options.postprocess import PostprocessOptions
from posefuse.model.status import Source
from posefuse.postprocess.kalman import smooth_kalman
from posefuse.postprocess.points import Clock, Points

_TOLERANCE = 1e-6
_DIAGONAL = (0, 3, 5)
"""Variances among the six numbers of a covariance."""


def fill(points: Points, clock: Clock, options: PostprocessOptions) -> Points:
    """Fill short gaps.

    The smoother gives the covariance inside the gap; for linear and cubic interpolation, it follows from the motion
    model of the smoother.

    Args:
        points: with gaps.
        clock: of their frames.
        options: method, largest duration and motion model.
    """
    short = short_gaps(points.known, clock, options.max_gap_s)
    if options.fill == "none" or not short.any():
        return points
    if options.fill == "smoother":
        expected = smooth_kalman(points, clock, options.kalman)
        xyz, covariance = expected.xyz_m, expected.covariance_m2
        short = short & np.isfinite(xyz).all(axis=-1)
    else:
        xyz = _interpolate(points.xyz_m, short, clock, cubic=options.fill == "pchip")
        covariance = _interpolated_covariance(points, short, clock, options.kalman.acceleration)
    return Points(
        np.where(short[..., None], xyz, points.xyz_m),
        np.where(short[..., None], covariance, points.covariance_m2),
        np.where(short, Source.FILLED, points.source).astype(np.int8),
    )


def short_gaps(known: np.ndarray, clock: Clock, max_gap_s: float) -> np.ndarray:
    """Return missing points in gaps of at most ``max_gap_s``, between known ones, shape (frame, point), bool.

    A gap lasts from one period after the last known point to the next known point.
    """
    short = np.zeros_like(known)
    for p in range(known.shape[1]):
        for start, stop in _gaps(known[:, p]):
            missing_s = clock.time_s[stop] - clock.time_s[start - 1] - clock.period_s
            short[start:stop, p] = missing_s <= max_gap_s + _TOLERANCE * clock.period_s
    return short & np.isfinite(clock.time_s)[:, None]


def _gaps(known: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield the ranges of frames in which one point is missing, without those before its first and after its last."""
    known_frames = np.flatnonzero(known)
    for before, after in pairwise(known_frames.tolist()):
        if after > before + 1:
            yield before + 1, after


def _interpolate(xyz_m: np.ndarray, missing: np.ndarray, clock: Clock, *, cubic: bool) -> np.ndarray:
    """Return positions interpolated at the missing points, shape (frame, point, 3)."""
    out = xyz_m.copy()
    for p in np.flatnonzero(missing.any(axis=0)):
        frames = missing[:, p]
        known = np.isfinite(xyz_m[:, p, 0]) & np.isfinite(clock.time_s)
        time_s, at_s, values = clock.time_s[known], clock.time_s[frames], xyz_m[known, p]
        if cubic:
            out[frames, p] = PchipInterpolator(time_s, values, axis=0)(at_s)
        else:
            out[frames, p] = np.stack([np.interp(at_s, time_s, values[:, axis]) for axis in range(3)], axis=-1)
    return out


def _interpolated_covariance(points: Points, missing: np.ndarray, clock: Clock, acceleration: float) -> np.ndarray:
    """Return covariances at the missing points, shape (frame, point, 6).

    The errors of the two ends enter with the weights of a line, as if they were equal, which is the largest effect that
    correlated errors can have. In a gap of T seconds, a motion whose acceleration is white noise of density q deviates
    from the line by the variance q t^2 (T - t)^2 / (3 T) after t seconds: the integral of the squared Green's function
    of the second derivative. Cubic interpolation deviates less.
    """
    out = np.full_like(points.covariance_m2, np.nan)
    for p in np.flatnonzero(missing.any(axis=0)):
        known = np.flatnonzero(points.known[:, p] & np.isfinite(clock.time_s))
        frames = np.flatnonzero(missing[:, p])
        end = np.searchsorted(known, frames)
        before, after = known[end - 1], known[end]
        gap_s, since_s = clock.time_s[after] - clock.time_s[before], clock.time_s[frames] - clock.time_s[before]
        weight = (since_s / gap_s)[:, None]
        out[frames, p] = (1.0 - weight) * points.covariance_m2[before, p] + weight * points.covariance_m2[after, p]
        out[frames[:, None], p, _DIAGONAL] += (acceleration * (since_s * (gap_s - since_s)) ** 2 / (3.0 * gap_s))[
            :, None
        ]
    return out


def drop(points: Points, unreliable: np.ndarray) -> Points:
    """Remove points.

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
