"""Prediction of tracks to the time of a frame."""

import numpy as np
import pytest

from posefuse.model.options.tracker import TrackerOptions
from posefuse.tracking.predict import predict_swaps


@pytest.mark.parametrize("dt_s", [0.01, 0.04, 0.1])
def test_swap_probability_decays_with_time_and_not_with_frames(dt_s: float):
    options = TrackerOptions(swap_log_odds=-5.0, swap_duration_s=0.3)
    swapped = np.array([[[1.0, 0.0]]])
    for _ in range(round(0.6 / dt_s)):
        predict_swaps(swapped, dt_s, options)
    usual = 1.0 / (1.0 + np.exp(5.0))
    np.testing.assert_allclose(swapped[0, 0], usual + np.exp(-2.0) * (np.array([1.0, 0.0]) - usual), rtol=1e-9)


def test_swap_odds_stay_finite():
    swapped = np.array([[[0.0, 1.0]]])
    predict_swaps(swapped, 0.0, TrackerOptions(swap_log_odds=-1e6))
    assert ((swapped > 0.0) & (swapped < 1.0)).all()
    predict_swaps(swapped, 1e3, TrackerOptions(swap_log_odds=-1e6))
    assert np.log(swapped / (1.0 - swapped)).max() < -500.0
