"""Gaps and their interpolation."""

import numpy as np
import pytest

from posefuse.model.options.postprocess import KalmanOptions, PostprocessOptions
from posefuse.model.status import Source
from posefuse.postprocess.filters import smooth
from posefuse.postprocess.gaps import drop, fill
from posefuse.postprocess.points import Clock, contiguous_ranges

from .conftest import RATE_HZ, clock_of, points_of, wave


@pytest.mark.parametrize("how", ["linear", "pchip", "smoother"])
def test_only_short_inner_gaps_are_filled(how):
    path = wave(100, 0.5)
    holed = path.copy()
    for start, stop in ((0, 3), (20, 26), (50, 63), (95, 100)):
        holed[start:stop] = np.nan
    options = PostprocessOptions(fill=how, max_gap_s=6 / RATE_HZ)
    out = fill(points_of(holed), clock_of(100), options)
    expected = np.isfinite(holed[:, 0, 0])
    expected[20:26] = True
    assert np.array_equal(out.known[:, 0], expected)
    assert (out.source[20:26] == Source.FILLED).all()
    assert (out.source[expected & np.isfinite(holed[:, 0, 0])] == Source.MEASURED).all()
    assert np.abs(out.xyz_m[20:26] - path[20:26]).max() < 0.01
    np.testing.assert_array_equal(out.xyz_m[:20], holed[:20])
    assert np.array_equal(np.isfinite(out.covariance_m2).all(axis=-1), out.known)
    sd = np.sqrt(out.covariance_m2[20:26, 0, 0])
    assert sd[[2, 3]].min() > sd[[0, 5]].max() > np.sqrt(out.covariance_m2[19, 0, 0])


def test_linear_interpolation():
    xyz = np.full((5, 1, 3), np.nan)
    xyz[0], xyz[4] = 0.0, 4.0
    out = fill(points_of(xyz), clock_of(5), PostprocessOptions(fill="linear", max_gap_s=1.0))
    np.testing.assert_allclose(out.xyz_m[:, 0, 0], [0, 1, 2, 3, 4], atol=1e-12)


def test_unrecorded_frames_split_ranges_and_lengthen_gaps():
    time = np.array([0, 1, 2, 8, 9, 10]) / RATE_HZ
    clock = Clock.of(time, RATE_HZ)
    assert contiguous_ranges(np.ones(6, dtype=bool), clock.is_contiguous) == [(0, 3), (3, 6)]
    xyz = np.ones((6, 1, 3))
    xyz[3] = np.nan
    assert not fill(points_of(xyz), clock, PostprocessOptions(fill="linear", max_gap_s=0.09)).known[3, 0]
    assert fill(points_of(xyz), clock, PostprocessOptions(fill="linear", max_gap_s=0.1)).known[3, 0]


def test_smoothed_filled_points_stay_marked_as_filled():
    path = wave(60, 1.0)
    path[30:33] = np.nan
    options = PostprocessOptions(fill="pchip")
    filled = fill(points_of(path), clock_of(60), options)
    out = smooth(filled, clock_of(60), "butterworth", options)
    assert (out.source[30:33] == Source.FILLED).all()
    assert (out.source[:30] == Source.SMOOTHED).all()
    np.testing.assert_array_equal(out.covariance_m2[30:33], filled.covariance_m2[30:33])


@pytest.mark.parametrize("how", ["linear", "pchip"])
def test_covariance_of_interpolated_points_holds_for_motion_with_white_acceleration(how, rng):
    frames, n, density = 13, 4000, 20.0
    steps = rng.standard_normal((frames * 20, n)) * np.sqrt(density / (RATE_HZ * 20)) / (RATE_HZ * 20)
    paths = np.cumsum(np.cumsum(steps, axis=0), axis=0)[19::20]
    paths = paths + np.arange(frames)[:, None] * rng.standard_normal(n) * 0.05
    measured = paths + 0.01 * rng.standard_normal(paths.shape)
    points = points_of(np.repeat(measured[..., None], 3, axis=-1))
    gap = np.zeros(frames, dtype=bool)
    gap[3:9] = True
    points = drop(points, np.repeat(gap[:, None], n, axis=1))
    points.covariance_m2[~gap] = 1e-4 * np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
    options = PostprocessOptions(fill=how, max_gap_s=1.0, kalman=KalmanOptions(acceleration=density))
    out = fill(points, clock_of(frames), options)
    ratio = (out.xyz_m[gap][..., 0] - paths[gap]).std(axis=1) / np.sqrt(out.covariance_m2[gap][:, 0, 0])
    # Errors of the two ends are independent here, and the stated ones hold for any correlation.
    assert ratio.max() < 1.05
    assert ratio.min() > 0.6


def test_filled_points_are_no_measurements_of_the_smoother():
    path = wave(60, 1.0)
    path[30:33] = np.nan
    options = PostprocessOptions(fill="linear")
    expected = smooth(points_of(path), clock_of(60), "kalman", options)
    out = smooth(fill(points_of(path), clock_of(60), options), clock_of(60), "kalman", options)
    np.testing.assert_array_equal(out.xyz_m[expected.known], expected.xyz_m[expected.known])
