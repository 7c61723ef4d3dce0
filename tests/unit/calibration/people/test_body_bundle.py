"""The bundle adjustment of bodies where observations determine nothing."""

import numpy as np

from posefuse.calibration.people.body_bundle import _Terms


def test_no_observations_give_no_step():
    terms = _Terms(0.0, np.zeros((3, 6, 6)), np.zeros((3, 6, 15)), np.zeros((14, 14)), np.zeros(14))
    assert terms.step(np.arange(7, 14), 1e-3) is None
