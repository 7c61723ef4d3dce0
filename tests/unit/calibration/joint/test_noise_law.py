"""The law of errors is recovered from their correlation over time."""

import numpy as np
import pytest
from benchmarks.clock_coverage import correlated_errors

from posefuse.calibration.joint.noise_law import NoiseLaw, estimate_law


def test_correlations_are_those_measured():
    """0.85 between frames at 25 fps, 0.4 after a second."""
    assert NoiseLaw(0.45).correlation(0.04) == pytest.approx(0.85, abs=0.02)
    assert NoiseLaw(0.45).correlation(1.0) == pytest.approx(0.40, abs=0.02)


@pytest.mark.parametrize("slow", [0.0, 0.45, 0.8])
def test_share_of_slow_errors_is_recovered(rng, slow):
    errors = correlated_errors((1500, 300), rng, slow)
    assert estimate_law(errors, np.arange(1500) / 25.0, 0.0).slow == pytest.approx(slow, abs=0.06)


def test_short_recordings_keep_the_usual_law(rng):
    assert estimate_law(rng.standard_normal((1, 10)), np.zeros(1), 0.0) == NoiseLaw()
