"""Properties of gaps and filters."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posefuse.errors import OptionsError
from posefuse.model.options.postprocess import (
    ButterworthOptions,
    Filter,
    HampelOptions,
    KalmanOptions,
    MedianOptions,
    PostprocessOptions,
    SavgolOptions,
)
from posefuse.model.status import Source
from posefuse.postprocess.filters import smooth
from posefuse.postprocess.kalman import smooth_kalman

from .conftest import RATE_HZ, clock_of, points_of, wave

FILTERS: tuple[Filter, ...] = ("hampel", "median", "butterworth", "savgol", "one_euro", "kalman")


LINEAR = ("butterworth", "savgol", "kalman")


@pytest.mark.parametrize("name", FILTERS)
def test_constant_points_stay_unchanged(name):
    points = points_of(np.broadcast_to([1.0, -2.0, 0.5], (40, 3, 3)).copy())
    out = smooth(points, clock_of(40), name, PostprocessOptions())
    np.testing.assert_allclose(out.xyz_m, points.xyz_m, atol=1e-6)


@pytest.mark.parametrize("name", FILTERS)
def test_missing_points_stay_missing_and_ranges_are_independent(name):
    rng = np.random.default_rng(2)
    xyz = rng.normal(size=(60, 2, 3))
    xyz[20:30, 0] = np.nan
    xyz[:, 1] = xyz[:, 0]
    xyz[30:, 1] += 5.0
    out = smooth(points_of(xyz), clock_of(60), name, PostprocessOptions())
    assert np.array_equal(out.known, np.isfinite(xyz[..., 0]))
    if name != "kalman":
        np.testing.assert_allclose(out.xyz_m[:20, 1], out.xyz_m[:20, 0], atol=1e-12)
        np.testing.assert_allclose(out.xyz_m[30:, 1], out.xyz_m[30:, 0] + 5.0, atol=1e-9)


@pytest.mark.parametrize("name", FILTERS)
@given(seed=st.integers(0, 999))
@settings(max_examples=5, deadline=None)
def test_filters_commute_with_rigid_motions(name, seed):
    rng = np.random.default_rng(seed)
    xyz = wave(50, 2.0) + 0.01 * rng.normal(size=(50, 1, 3))
    shift = rng.uniform(-3, 3, 3)
    once = smooth(points_of(xyz), clock_of(50), name, PostprocessOptions())
    moved = smooth(points_of(xyz + shift), clock_of(50), name, PostprocessOptions())
    np.testing.assert_allclose(moved.xyz_m, once.xyz_m + shift, atol=1e-5 if name == "kalman" else 1e-9)


@pytest.mark.parametrize("name", [name for name in FILTERS if name not in ("one_euro", "kalman")])
def test_symmetric_filters_commute_with_time_reversal(name):
    xyz = wave(80, 1.5) + 0.01 * np.random.default_rng(0).normal(size=(80, 1, 3))
    other = smooth(points_of(xyz), clock_of(80), name, PostprocessOptions())
    back = smooth(points_of(xyz[::-1]), clock_of(80), name, PostprocessOptions())
    # Forward and backward differ at the ends, where the filter has begun in the other.
    np.testing.assert_allclose(back.xyz_m[::-1][30:-30], other.xyz_m[30:-30], atol=1e-5)


@pytest.mark.parametrize("order", [2, 4, 8])
@pytest.mark.parametrize("cutoff_hz", [3.0, 6.0, 20.0])
def test_butterworth_keeps_71_percent_at_its_cutoff_without_delay(order, cutoff_hz):
    options = PostprocessOptions(butterworth=ButterworthOptions(order, cutoff_hz))
    frames = 1200
    out = smooth(points_of(wave(frames, cutoff_hz)), clock_of(frames), "butterworth", options)
    middle = slice(300, -300)
    ratio = out.xyz_m[middle, 0, :2] / wave(frames, cutoff_hz)[middle, 0, :2]
    big = np.abs(wave(frames, cutoff_hz)[middle, 0, :2]) > 0.03
    np.testing.assert_allclose(ratio[big], np.sqrt(0.5), atol=2e-3)
    slow = smooth(points_of(wave(frames, cutoff_hz / 8)), clock_of(frames), "butterworth", options)
    np.testing.assert_allclose(slow.xyz_m[middle], wave(frames, cutoff_hz / 8)[middle], atol=2e-3)


def test_actual_frame_rate_is_used():
    options = PostprocessOptions(butterworth=ButterworthOptions(4, 6.0))
    for rate in (50.0, 240.0):
        path = wave(1200, 6.0, rate_hz=rate)
        out = smooth(points_of(path), clock_of(1200, rate), "butterworth", options)
        assert np.abs(out.xyz_m[400:800, 0, 0]).max() == pytest.approx(0.1 * np.sqrt(0.5), rel=0.01)


def test_cutoff_above_half_the_rate_is_an_error():
    options = PostprocessOptions(smooth=("butterworth",), butterworth=ButterworthOptions(4, 30.0))
    with pytest.raises(OptionsError, match=r"half the frame rate \(30 Hz\)"):
        smooth(points_of(wave(20, 1.0)), clock_of(20), "butterworth", options)


def test_savgol_keeps_polynomials():
    t = np.arange(60) / RATE_HZ
    cubic = np.stack([t**3 - t, 2 * t**2, t], axis=-1)[:, None]
    out = smooth(points_of(cubic), clock_of(60), "savgol", PostprocessOptions(savgol=SavgolOptions(0.2, 3)))
    np.testing.assert_allclose(out.xyz_m, cubic, atol=1e-12)


def test_hampel_replaces_only_outliers():
    path = wave(100, 0.5) + 0.005 * np.random.default_rng(3).normal(size=(100, 1, 3))
    hit = path.copy()
    hit[40, 0, 1] += 0.3
    out = smooth(points_of(hit), clock_of(100), "hampel", PostprocessOptions(hampel=HampelOptions(0.25, 3.0)))
    assert np.abs(out.xyz_m - path).max() < 0.02
    assert out.source[40, 0] == Source.SMOOTHED
    assert (out.source == Source.SMOOTHED).mean() < 0.1


def test_median_removes_single_jumps():
    ramp = np.linspace(0, 1, 60)[:, None, None] * np.ones(3)
    hit = ramp.copy()
    hit[30] += 1.0
    out = smooth(points_of(hit), clock_of(60), "median", PostprocessOptions(median=MedianOptions(0.1)))
    assert np.abs(out.xyz_m - ramp).max() < 0.05


def test_one_euro_is_causal_and_reduces_jitter():
    rng = np.random.default_rng(1)
    noisy = 0.01 * rng.normal(size=(200, 1, 3))
    out = smooth(points_of(noisy), clock_of(200), "one_euro", PostprocessOptions())
    assert out.xyz_m[50:].std() < 0.7 * noisy[50:].std()
    later = noisy.copy()
    later[120:] += 1.0
    again = smooth(points_of(later), clock_of(200), "one_euro", PostprocessOptions())
    np.testing.assert_array_equal(again.xyz_m[:120], out.xyz_m[:120])


def test_defaults_keep_the_amplitude_of_a_fast_hand():
    swing = wave(240, 3.0, amplitude=0.15)
    out = smooth_kalman(points_of(swing), clock_of(240), KalmanOptions())
    assert np.abs(out.xyz_m[60:180, 0, 0]).max() > 0.98 * 0.15


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"smooth": ("butter",)}, "Did you mean 'butterworth'"),
        ({"smooth": "kalman"}, "a list of choices from hampel"),
        ({"fill": "cubic"}, "must be one of none, linear, pchip, smoother, got 'cubic'"),
        ({"max_gap_s": 0.0}, "max_gap_s must be a finite number above 0 s"),
        ({"drop_beyond_px": -1.0}, "drop_beyond_px must be a finite number above 0 px"),
        ({"smooth": ("median", "median")}, "twice"),
    ],
)
def test_invalid_options_are_errors(change, says):
    with pytest.raises(OptionsError, match=says):
        replace(PostprocessOptions(), **change)
