"""Filters over time: each keypoint by itself, and of it each unbroken stretch by itself.

What a fixed filter makes of errors depends on how long they last, which it does not know; detectors' errors last longer
than a filter's window. So covariances stay those of the points that were filtered. See docs/methods/postprocess.md.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import butter, savgol_filter, sosfiltfilt

from posefuse.errors import OptionsError
from posefuse.model.options.postprocess import (
    ButterworthOptions,
    Filter,
    HampelOptions,
    MedianOptions,
    OneEuroOptions,
    PostprocessOptions,
    SavgolOptions,
)
from posefuse.model.status import Source
from posefuse.postprocess.kalman import smoothed
from posefuse.postprocess.points import Clock, Points, stretches

_ROBUST_SD = 1.4826
_SHORTEST = 3
"""Of fewer points nothing tells movement from noise: they stay as they are."""

Smoother = Callable[[np.ndarray], np.ndarray]
"""From an unbroken stretch of one keypoint's positions, shape (frame, 3), to what is left of it, likewise."""


def smooth(points: Points, clock: Clock, name: Filter, options: PostprocessOptions) -> Points:
    """Run a filter over points; those that it changes are marked as smoothed, filled ones stay marked as filled.

    Args:
        points: missing ones are NaN; none of them is filled.
        clock: of their frames.
        name: of the filter.
        options: of all of them.

    Raises:
        OptionsError: if the filter cannot be had at this frame rate.
    """
    if name == "kalman":
        return _with_covariance(points, smoothed(points, clock, options.kalman))
    smoother = _SMOOTHERS[name](options, clock)
    xyz = points.xyz_m.copy()
    for p in range(xyz.shape[1]):
        for start, stop in stretches(points.known[:, p], clock.follows):
            if stop - start >= _SHORTEST:
                xyz[start:stop, p] = smoother(xyz[start:stop, p])
    return replace(points, xyz_m=xyz, source=_sources(points, xyz))


def _with_covariance(points: Points, expected: Points) -> Points:
    """What the smoother says of points that are there; those without covariance, which it did not see, by it alone."""
    there = (points.known & expected.known)[..., None]
    xyz = np.where(there, expected.xyz_m, points.xyz_m)
    covariance = np.where(there, expected.covariance_m2, points.covariance_m2)
    return Points(xyz, covariance, _sources(points, xyz))


def _sources(points: Points, xyz_m: np.ndarray) -> np.ndarray:
    changed = (xyz_m != points.xyz_m).any(axis=-1) & points.known & (points.source != Source.FILLED)
    return np.where(changed, Source.SMOOTHED, points.source).astype(np.int8)


def _hampel(options: HampelOptions, clock: Clock) -> Smoother:
    half = clock.window(options.window_s) // 2

    def smoother(xyz_m: np.ndarray) -> np.ndarray:
        padded = np.pad(xyz_m, ((half, half), (0, 0)), constant_values=np.nan)
        around = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0)
        middle = np.nanmedian(around, axis=-1)
        deviation = _ROBUST_SD * np.nanmedian(np.abs(around - middle[..., None]), axis=-1)
        return np.where(np.abs(xyz_m - middle) > options.sigma * deviation, middle, xyz_m)

    return smoother


def _running_median(options: MedianOptions, clock: Clock) -> Smoother:
    return partial(_median, size=clock.window(options.window_s))


def _median(xyz_m: np.ndarray, size: int) -> np.ndarray:
    """The running median; towards the ends the window shrinks, so that a movement's ends are not flattened."""
    out = median_filter(xyz_m, size=(size, 1), mode="nearest")
    for i in range(min(size // 2, (len(xyz_m) + 1) // 2)):
        out[i] = np.median(xyz_m[: 2 * i + 1], axis=0)
        out[-1 - i] = np.median(xyz_m[len(xyz_m) - 2 * i - 1 :], axis=0)
    return out


def _butterworth(options: ButterworthOptions, clock: Clock) -> Smoother:
    sections = np.asarray(
        butter(options.order // 2, pass_cutoff_hz(options, clock), fs=1.0 / clock.period_s, output="sos")
    )
    # As many frames as SciPy thinks the ends need, where there are so many.
    reach = 3 * (2 * len(sections) + 1)

    def smoother(xyz_m: np.ndarray) -> np.ndarray:
        return sosfiltfilt(sections, xyz_m, axis=0, padlen=min(reach, len(xyz_m) - 1))

    return smoother


def pass_cutoff_hz(options: ButterworthOptions, clock: Clock) -> float:
    """The cut-off of each of the two passes that together have the one asked for.

    Digital filters bend the frequency axis, which their design undoes at this cut-off, so that the correction is made
    on the bent axis. Source: Winter 2009, "Biomechanics and Motor Control of Human Movement", section 2.2.4.4.

    Raises:
        OptionsError: if it is not below half the frame rate.
    """
    rate_hz = 1.0 / clock.period_s
    if not options.cutoff_hz < (0.5 - 1e-9) * rate_hz:
        raise OptionsError(
            f"postprocess.butterworth.cutoff_hz must be below half the frame rate ({0.5 * rate_hz:.4g} Hz), got "
            f"{options.cutoff_hz:g}."
        )
    bent = np.tan(np.pi * options.cutoff_hz / rate_hz) / (np.sqrt(2.0) - 1.0) ** (1.0 / options.order)
    return float(np.arctan(bent) * rate_hz / np.pi)


def _savgol(options: SavgolOptions, clock: Clock) -> Smoother:
    size = clock.window(options.window_s)
    if size <= options.degree:
        raise OptionsError(
            f"postprocess.savgol.window_s ({options.window_s:g} s) holds {size} frames at {1.0 / clock.period_s:.4g} "
            f"Hz; a polynomial of degree {options.degree} needs more than {options.degree}. Make it longer."
        )

    def smoother(xyz_m: np.ndarray) -> np.ndarray:
        fitting = min(size, len(xyz_m) - (len(xyz_m) + 1) % 2)
        if fitting <= options.degree:
            return xyz_m
        return np.asarray(savgol_filter(xyz_m, fitting, options.degree, axis=0))

    return smoother


def _one_euro(options: OneEuroOptions, clock: Clock) -> Smoother:
    """Source: Casiez, Roussel & Vogel 2012, "1 Euro Filter"; speed is that of the point, not of each coordinate."""

    def weight(cutoff_hz: float) -> float:
        return 1.0 / (1.0 + 1.0 / (2.0 * np.pi * cutoff_hz * clock.period_s))

    of_velocity = weight(options.speed_cutoff_hz)

    def smoother(xyz_m: np.ndarray) -> np.ndarray:
        out = xyz_m.copy()
        velocity = np.zeros(3)
        for f in range(1, len(out)):
            velocity += of_velocity * ((xyz_m[f] - out[f - 1]) / clock.period_s - velocity)
            share = weight(options.min_cutoff_hz + options.beta * float(np.linalg.norm(velocity)))
            out[f] = out[f - 1] + share * (xyz_m[f] - out[f - 1])
        return out

    return smoother


_SMOOTHERS: Mapping[Filter, Callable[[PostprocessOptions, Clock], Smoother]] = {
    "hampel": lambda options, clock: _hampel(options.hampel, clock),
    "median": lambda options, clock: _running_median(options.median, clock),
    "butterworth": lambda options, clock: _butterworth(options.butterworth, clock),
    "savgol": lambda options, clock: _savgol(options.savgol, clock),
    "one_euro": lambda options, clock: _one_euro(options.one_euro, clock),
}
