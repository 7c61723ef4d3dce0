"""Run the post-processing steps in order: drop, fill, smooth, make bones rigid."""

from dataclasses import replace

import numpy as np

from posefuse.model.options.postprocess import PostprocessOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import Source
from posefuse.postprocess.bones import Bones, make_rigid
from posefuse.postprocess.filters import pass_cutoff_hz, smooth
from posefuse.postprocess.gaps import drop, fill
from posefuse.postprocess.points import Clock, Points

_NEGLIGIBLE = 1e-10
"""Remaining influence of a point at which a window may end: invisible in the digits of a millimeter."""

_MAX_MARGIN_S = 30.0
_SMOOTHER_MARGIN_S = 3.0


def postprocess(layer: Layer, clock: Clock, options: PostprocessOptions, bones: Bones | None = None) -> Layer:
    """Drop unreliable points, fill short gaps, smooth, and make bones rigid, as set in the options.

    Args:
        layer: of consecutive frames.
        clock: of its frames.
        options: steps and their settings.
        bones: bone lengths to apply; None keeps them.

    Returns:
        A layer of the same shape. Filled points have the status and the source FILLED, changed ones the source
        SMOOTHED; reprojection errors are those of the given layer.

    Raises:
        OptionsError: if a filter is not possible at this frame rate.
    """
    points = drop(Points.of(layer), unreliable(layer, options).reshape(layer.points_m.shape[0], -1))
    points = fill(points, clock, options)
    for name in options.smooth:
        points = smooth(points, clock, name, options)
    if bones is not None:
        points = _apply_bones(bones, points, layer.points_m.shape)
    return points.into(layer)


def unreliable(layer: Layer, options: PostprocessOptions) -> np.ndarray:
    """Return which points the options drop, shape (frame, person, keypoint), bool."""
    out = np.zeros(layer.points_m.shape[:3], dtype=bool)
    if options.drop_beyond_px is not None:
        out |= np.asarray(layer.reprojection_error_px[:]) > options.drop_beyond_px
    if options.drop_beyond_sd_m is not None:
        out |= np.sqrt((layer.sd_m**2).mean(axis=-1)) > options.drop_beyond_sd_m
    return out


def _apply_bones(bones: Bones, points: Points, shape: tuple[int, ...]) -> Points:
    """Return the points with constant bone lengths."""
    xyz = make_rigid(points.xyz_m.reshape(shape), bones).reshape(points.xyz_m.shape)
    changed = (xyz != points.xyz_m).any(axis=-1) & points.known & (points.source != Source.FILLED)
    return replace(points, xyz_m=xyz, source=np.where(changed, Source.SMOOTHED, points.source).astype(np.int8))


def margin_s(options: PostprocessOptions, clock: Clock) -> float:
    """Return the seconds beyond a range of frames that the range needs to match the result of the whole recording.

    The value is at most half a minute; filters with a longer memory are cut there.

    Raises:
        OptionsError: if a filter is not possible at this frame rate.
    """
    # A gap and two points on either side of it.
    needed = [] if options.fill == "none" else [options.max_gap_s + 4.0 * clock.period_s]
    if options.fill == "smoother":
        needed[0] += _SMOOTHER_MARGIN_S
    needed += [_filter_memory_s(name, options, clock) for name in options.smooth]
    return min(sum(needed), _MAX_MARGIN_S)


def _filter_memory_s(name: str, options: PostprocessOptions, clock: Clock) -> float:
    """Return how long a point influences the result of a filter."""
    match name:
        case "butterworth":
            from scipy.signal import butter, sos2zpk  # Takes half a second to load.

            settings = options.butterworth
            sections = butter(
                settings.order // 2, pass_cutoff_hz(settings, clock), fs=1.0 / clock.period_s, output="sos"
            )
            slowest = float(np.abs(np.asarray(sos2zpk(sections)[1])).max())
            return clock.period_s * (np.log(_NEGLIGIBLE) / np.log(max(slowest, 1e-6)) + 2.0 * settings.order)
        case "savgol":
            return options.savgol.window_s + clock.period_s
        case "median":
            return options.median.window_s + clock.period_s
        case "hampel":
            return 2.0 * (options.hampel.window_s + clock.period_s)
        case "one_euro":
            slowest_hz = min(options.one_euro.min_cutoff_hz, options.one_euro.speed_cutoff_hz)
            return -float(np.log(_NEGLIGIBLE)) / (2.0 * np.pi * slowest_hz) + 10.0 * clock.period_s
        case _:
            return _SMOOTHER_MARGIN_S
