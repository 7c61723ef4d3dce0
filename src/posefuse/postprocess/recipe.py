"""The steps of post-processing in their order: drop, fill, smooth, make bones rigid."""

from dataclasses import replace

import numpy as np
from scipy.signal import butter, sos2zpk

from posefuse.model.options.postprocess import PostprocessOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import Source
from posefuse.postprocess.bones import Bones, make_rigid
from posefuse.postprocess.filters import pass_cutoff_hz, smooth
from posefuse.postprocess.gaps import drop, fill
from posefuse.postprocess.points import Clock, Points

_FADED = 1e-10
"""What is left of a point's influence where a window may end: nothing that a float of a millimetre's digits shows."""

_MOST_MARGIN_S = 30.0
_SMOOTHER_MARGIN_S = 3.0


def postprocess(layer: Layer, clock: Clock, options: PostprocessOptions, bones: Bones | None = None) -> Layer:
    """Points with unreliable ones dropped, short gaps filled, smoothed, and on rigid bones, as the options say.

    Args:
        layer: of consecutive frames.
        clock: of its frames.
        options: what to do.
        bones: whose lengths points are put at; None leaves them.

    Returns:
        A layer of the same shape. Points that were missing and now are not have the status and the source FILLED,
        moved ones the source SMOOTHED; reprojection errors are still those of the layer given.

    Raises:
        OptionsError: if a filter cannot be had at this frame rate.
    """
    points = drop(Points.of(layer), unreliable(layer, options).reshape(layer.points_m.shape[0], -1))
    points = fill(points, clock, options)
    for name in options.smooth:
        points = smooth(points, clock, name, options)
    if bones is not None:
        points = _on(bones, points, layer.points_m.shape)
    return points.into(layer)


def unreliable(layer: Layer, options: PostprocessOptions) -> np.ndarray:
    """Shape (frame, person, keypoint), bool: which points the options drop."""
    out = np.zeros(layer.points_m.shape[:3], dtype=bool)
    if options.drop_beyond_px is not None:
        out |= np.asarray(layer.reprojection_error_px[:]) > options.drop_beyond_px
    if options.drop_beyond_sd_m is not None:
        out |= np.sqrt((layer.sd_m**2).mean(axis=-1)) > options.drop_beyond_sd_m
    return out


def _on(bones: Bones, points: Points, shape: tuple[int, ...]) -> Points:
    xyz = make_rigid(points.xyz_m.reshape(shape), bones).reshape(points.xyz_m.shape)
    moved = (xyz != points.xyz_m).any(axis=-1) & points.known & (points.source != Source.FILLED)
    return replace(points, xyz_m=xyz, source=np.where(moved, Source.SMOOTHED, points.source).astype(np.int8))


def margin_s(options: PostprocessOptions, clock: Clock) -> float:
    """How many seconds beyond a range of frames it takes for the range to come out as in the whole recording.

    At most half a minute: filters that remember for longer are cut there.

    Raises:
        OptionsError: if a filter cannot be had at this frame rate.
    """
    # A gap and the two points on either side of it.
    needed = [] if options.fill == "none" else [options.max_gap_s + 4.0 * clock.period_s]
    if options.fill == "smoother":
        needed[0] += _SMOOTHER_MARGIN_S
    needed += [_memory_s(name, options, clock) for name in options.smooth]
    return min(sum(needed), _MOST_MARGIN_S)


def _memory_s(name: str, options: PostprocessOptions, clock: Clock) -> float:
    """For how long a filter remembers a point."""
    match name:
        case "butterworth":
            wanted = options.butterworth
            sections = butter(wanted.order // 2, pass_cutoff_hz(wanted, clock), fs=1.0 / clock.period_s, output="sos")
            slowest = float(np.abs(np.asarray(sos2zpk(sections)[1])).max())
            return clock.period_s * (np.log(_FADED) / np.log(max(slowest, 1e-6)) + 2.0 * wanted.order)
        case "savgol":
            return options.savgol.window_s + clock.period_s
        case "median":
            return options.median.window_s + clock.period_s
        case "hampel":
            return 2.0 * (options.hampel.window_s + clock.period_s)
        case "one_euro":
            slowest_hz = min(options.one_euro.min_cutoff_hz, options.one_euro.speed_cutoff_hz)
            return -float(np.log(_FADED)) / (2.0 * np.pi * slowest_hz) + 10.0 * clock.period_s
        case _:
            return _SMOOTHER_MARGIN_S
