"""Wrong frame rates."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.people.bearings import bearings_of
from posefuse.calibration.people.rates import rig_rates
from posefuse.synthetic.rigs import build_rig
from tests.filmed_people import filmed_person


@pytest.mark.parametrize("true_hz", [25.0, 30.0, 60.0])
def test_ratio_of_usual_rates_is_found(rng, true_hz):
    people = filmed_person(build_rig("corners", 3), rng, rates_hz=(30.0, true_hz, 30.0), duration_s=9.0)
    views = [bearings_of(view, people.skeleton) for view in people.views]
    # All files state 30 frames per second.
    views[1] = replace(views[1], time_s=np.arange(len(views[1].time_s)) / 30.0)
    np.testing.assert_allclose(rig_rates(views, [[0, 0, 0]]), [1.0, 30.0 / true_hz, 1.0])
