"""Spectrum of correlated errors, compared with dense matrices."""

import numpy as np
import pytest

from posefuse.trajectory.error_spectrum import _UNEVEN_MOTION, ErrorSpectrum

STEP_S = 1.0 / 60.0


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("correlation_s", [0.02, 0.2])
@pytest.mark.parametrize("time_constant_s", [0.02, 0.1])
def test_covariance_is_that_of_the_actual_errors(order, correlation_s, time_constant_s):
    frames, inflation, level = 401, 2.5, 0.7
    difference = np.diff(np.eye(frames), order, axis=0)
    gain = (STEP_S / time_constant_s) ** (2 * order)
    information = np.eye(frames) / inflation
    prior = difference.T @ difference / (gain * inflation)
    assumed = np.linalg.inv(information + prior)
    lag = np.abs(np.subtract.outer(np.arange(frames), np.arange(frames)))
    errors = level * np.exp(-lag * STEP_S / correlation_s)
    actual = assumed @ (information @ errors @ information + _UNEVEN_MOTION * prior) @ assumed
    spectrum = ErrorSpectrum(correlation_s, STEP_S, order, level)
    leverage = assumed[[200], 200] / inflation
    factor = spectrum.covariance_factor(np.array([inflation]), np.array([[np.log(gain)]]), leverage[None])
    assert factor[0, 0] == pytest.approx(actual[200, 200] / assumed[200, 200], rel=0.02)


def test_white_errors_change_nothing():
    spectrum = ErrorSpectrum(0.0, STEP_S, 3)
    assert np.array_equal(spectrum.power(np.array([0.01, 1.0])), np.ones(2))
    assert np.array_equal(spectrum.covariance_factor(np.ones(2), np.zeros((2, 5)), np.ones((2, 5))), np.ones((2, 5)))


def test_slow_paths_average_less_of_lasting_errors():
    power = ErrorSpectrum(0.2, STEP_S, 3).power(np.array([1e-9, 0.01, 0.1, 1.0, 100.0]))
    assert power[0] == 1.0
    assert (np.diff(power) >= 0.0).all()
    # Over a long time, an autoregression has the variance of white errors times (1 + r) / (1 - r).
    r = np.exp(-STEP_S / 0.2)
    assert power[-1] == pytest.approx((1.0 + r) / (1.0 - r), rel=1e-3)


def test_no_path_is_less_certain_than_a_single_frame_where_fewer_frames_than_usual_determine_it():
    spectrum = ErrorSpectrum(0.1, STEP_S, 3, level=0.7)
    log_gain, inflation = np.full((1, 3), -12.0), np.array([8.0])
    none, usual, alone = spectrum.covariance_factor(inflation, log_gain, np.array([[0.0, 0.05, 1.0]]))[0]
    assert none == usual
    # The inflated variance of the frame's own point becomes the actual one, and some motion is lost.
    assert 0.7 / 8.0 < alone < 2.0 * 0.7 / 8.0
    assert alone < 0.2 * usual


@pytest.mark.parametrize("correlation_s", [0.0, 1e-4, 0.05, 2.0, 1e3, 1e9, 1e300])
@pytest.mark.parametrize("frames", [1, 2, 30, 5000])
def test_variance_of_the_mean_of_correlated_errors(correlation_s, frames):
    """The factor is the number of frames times the variance of their mean, whose terms are summed here."""
    spectrum = ErrorSpectrum(correlation_s, 1.0 / 60.0, 2)
    correlation = np.exp(-1.0 / 60.0 / correlation_s) if correlation_s else 0.0
    lags = np.arange(1, frames)
    expected = 1.0 + 2.0 * ((1.0 - lags / frames) * correlation**lags).sum()
    actual = spectrum.mean_factor(np.array([1.0]), np.array([1.0 / frames]))
    np.testing.assert_allclose(actual, expected, rtol=1e-6)


@pytest.mark.parametrize("correlation_s", [1e3, 1e9, 1e300])
def test_errors_that_hardly_change_have_a_finite_spectrum(correlation_s):
    spectrum = ErrorSpectrum(correlation_s, 1.0 / 60.0, 2)
    assert np.isfinite(spectrum.power(np.array([0.0, 1e-3, 1.0, 1e6]))).all()
    factor = spectrum.covariance_factor(np.array([1.0]), np.linspace(-40.0, 20.0, 50)[None], np.full((1, 50), 0.2))
    assert np.isfinite(factor).all()
    assert (factor >= 0.0).all()
