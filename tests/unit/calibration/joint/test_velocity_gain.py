"""The loss of velocity by differences over some frames is measured."""

import numpy as np
import pytest
from benchmarks.clock_coverage import simulate

from posefuse.calibration.joint.estimate import estimate
from posefuse.calibration.joint.velocity_gain import velocity_gain


@pytest.mark.parametrize(("person", "duration_s", "expected"), [("walks", 5.0, 1.025), ("jumps", 15.0, 1.074)])
def test_gain_is_that_of_exact_movements(person, duration_s, expected):
    """The expected value is that of differences over 0.16 s of the exact points at 200 Hz."""
    recording, _ = simulate(person, duration_s, np.random.default_rng(3))
    joint = estimate(recording)
    assert joint is not None
    assert velocity_gain(recording, joint.rows, joint.parameters) == pytest.approx(expected, abs=0.03)


def test_person_who_stands_still_has_no_gain(stand):
    joint = estimate(stand[0])
    assert joint is not None
    assert velocity_gain(stand[0], joint.rows, joint.parameters) == 1.0
