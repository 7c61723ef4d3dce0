"""Filter points over time, each keypoint and each contiguous range of frames separately.

The effect of a fixed filter on errors depends on their correlation time, which is unknown to it and longer than the
window for detectors. Covariances therefore stay those of the unfiltered points. See docs/methods.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.ndimage import median_filter

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
from posefuse.postprocess.kalman import smooth_kalman
from posefuse.postprocess.points import Clock, Points, contiguous_ranges

_ROBUST_SD = 1.4826
_MIN_FRAMES = 3
"""Shorter ranges stay unchanged: they do not distinguish motion from noise."""

Smoother = Callable[[np.ndarray], np.ndarray]
"""Function from the positions in a contiguous range, shape (frame, 3), to smoothed positions of the same shape."""


def smooth(points: Points, clock: Clock, name: Filter, options: PostprocessOptions) -> Points:
    """Apply a filter; changed points are marked as smoothed, filled points stay marked as filled.

    Args:
        points: missing ones are NaN; they are not filled.
        clock: of their frames.
        name: name of the filter.
        options: of all filters.

    Raises:
        OptionsError: if the filter is not possible at this frame rate.
    """
    if name == "kalman":
        return _with_covariance(points, smooth_kalman(points, clock, options.kalman))
    smoother = _SMOOTHERS[name](options, clock)
    xyz = points.xyz_m.copy()
    for p in range(xyz.shape[1]):
        for start, stop in contiguous_ranges(points.known[:, p], clock.is_contiguous):
            if stop - start >= _MIN_FRAMES:
                xyz[start:stop, p] = smoother(xyz[start:stop, p])
    return replace(points, xyz_m=xyz, source=_sources(points, xyz))


def _with_covariance(points: Points, expected: Points) -> Points:
    """Return smoothed points and covariances where points exist and the smoother reaches."""
    in_both = (points.known & expected.known)[..., None]
    xyz = np.where(in_both, expected.xyz_m, points.xyz_m)
    covariance = np.where(in_both, expected.covariance_m2, points.covariance_m2)
    return Points(xyz, covariance, _sources(points, xyz))


def _sources(points: Points, xyz_m: np.ndarray) -> np.ndarray:
    """Return the source of each point after a change."""
    changed = (xyz_m != points.xyz_m).any(axis=-1) & points.known & (points.source != Source.FILLED)
    return np.where(changed, Source.SMOOTHED, points.source).astype(np.int8)


def _hampel(options: HampelOptions, clock: Clock) -> Smoother:
    """Return a Hampel filter: outliers are replaced by the median of the window."""
    half = clock.window(options.window_s) // 2

    def smoother(xyz_m: np.ndarray) -> np.ndarray:
        padded = np.pad(xyz_m, ((half, half), (0, 0)), constant_values=np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0)
        median = np.nanmedian(windows, axis=-1)
        deviation = _ROBUST_SD * np.nanmedian(np.abs(windows - median[..., None]), axis=-1)
        return np.where(np.abs(xyz_m - median) > options.sigma * deviation, median, xyz_m)

    return smoother


def _running_median(options: MedianOptions, clock: Clock) -> Smoother:
    """Return a running median."""
    return partial(_median, size=clock.window(options.window_s))


def _median(xyz_m: np.ndarray, size: int) -> np.ndarray:
    """Return the running median.

    The window shrinks toward the ends, so that the ends of a motion are not flattened.
    """
    out = median_filter(xyz_m, size=(size, 1), mode="nearest")
    for i in range(min(size // 2, (len(xyz_m) + 1) // 2)):
        out[i] = np.median(xyz_m[: 2 * i + 1], axis=0)
        out[-1 - i] = np.median(xyz_m[len(xyz_m) - 2 * i - 1 :], axis=0)
    return out


def _butterworth(options: ButterworthOptions, clock: Clock) -> Smoother:
    """Return a zero-phase Butterworth filter, forward and backward."""
    from scipy.signal import butter, sosfiltfilt  # Takes half a second to load.

    sections = np.asarray(
        butter(options.order // 2, pass_cutoff_hz(options, clock), fs=1.0 / clock.period_s, output="sos")
    )
    # SciPy's default padding, limited by the number of frames.
    padding = 3 * (2 * len(sections) + 1)

    def smoother(xyz_m: np.ndarray) -> np.ndarray:
        return sosfiltfilt(sections, xyz_m, axis=0, padlen=min(padding, len(xyz_m) - 1))

    return smoother


def pass_cutoff_hz(options: ButterworthOptions, clock: Clock) -> float:
    """Return the cutoff of each pass such that both passes together have the requested cutoff.

    Digital filters warp the frequency axis, and their design compensates this at the cutoff, so the correction is made
    on the warped axis. Source: Winter 2009, "Biomechanics and Motor Control of Human Movement", section 2.2.4.4.

    Raises:
        OptionsError: if the cutoff is not below half the frame rate.
    """
    rate_hz = 1.0 / clock.period_s
    if not options.cutoff_hz < (0.5 - 1e-9) * rate_hz:
        raise OptionsError(
            f"postprocess.butterworth.cutoff_hz must be below half the frame rate ({0.5 * rate_hz:.4g} Hz), got "
            f"{options.cutoff_hz:g}."
        )
    warped = np.tan(np.pi * options.cutoff_hz / rate_hz) / (np.sqrt(2.0) - 1.0) ** (1.0 / options.order)
    return float(np.arctan(warped) * rate_hz / np.pi)


def _savgol(options: SavgolOptions, clock: Clock) -> Smoother:
    """Return a Savitzky-Golay filter."""
    from scipy.signal import savgol_filter  # Takes half a second to load.

    size = clock.window(options.window_s)
    if size <= options.degree:
        raise OptionsError(
            f"postprocess.savgol.window_s ({options.window_s:g} s) contains {size} frames at "
            f"{1.0 / clock.period_s:.4g} Hz; a polynomial of degree {options.degree} needs more than {options.degree}. "
            "Increase window_s."
        )

    def smoother(xyz_m: np.ndarray) -> np.ndarray:
        size_used = min(size, len(xyz_m) - (len(xyz_m) + 1) % 2)
        if size_used <= options.degree:
            return xyz_m
        return np.asarray(savgol_filter(xyz_m, size_used, options.degree, axis=0))

    return smoother


def _one_euro(options: OneEuroOptions, clock: Clock) -> Smoother:
    """Return a 1 Euro filter with the speed of the point, not of each coordinate.

    Source: Casiez, Roussel and Vogel 2012, "1 Euro Filter".
    """

    def weight(cutoff_hz: float) -> float:
        return 1.0 / (1.0 + 1.0 / (2.0 * np.pi * cutoff_hz * clock.period_s))

    of_velocity = weight(options.speed_cutoff_hz)

    def smoother(xyz_m: np.ndarray) -> np.ndarray:
        out = xyz_m.copy()
        velocity = np.zeros(3)
        for f in range(1, len(out)):
            velocity += of_velocity * ((xyz_m[f] - out[f - 1]) / clock.period_s - velocity)
            gain = weight(options.min_cutoff_hz + options.beta * float(np.linalg.norm(velocity)))
            out[f] = out[f - 1] + gain * (xyz_m[f] - out[f - 1])
        return out

    return smoother


_SMOOTHERS: Mapping[Filter, Callable[[PostprocessOptions, Clock], Smoother]] = {
    "hampel": lambda options, clock: _hampel(options.hampel, clock),
    "median": lambda options, clock: _running_median(options.median, clock),
    "butterworth": lambda options, clock: _butterworth(options.butterworth, clock),
    "savgol": lambda options, clock: _savgol(options.savgol, clock),
    "one_euro": lambda options, clock: _one_euro(options.one_euro, clock),
}
