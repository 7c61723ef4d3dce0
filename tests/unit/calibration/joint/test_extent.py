"""Units of pose errors follow the size of the subject in the views."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.joint.equations import Rows, linearize
from posefuse.calibration.joint.estimate import sample_frames
from posefuse.calibration.joint.extent import PoseUnits
from posefuse.calibration.joint.parameters import JointParameters


@pytest.fixture(scope="module")
def rows(walk) -> Rows:
    recording = walk[0]
    still = np.zeros(recording.n_views)
    parameters = JointParameters(recording.rotation, recording.center_m, still, still)
    return linearize(recording, sample_frames(recording, 30), parameters, np.ones(recording.n_views))


def test_a_person_five_meters_away_has_the_usual_units(rows):
    units = PoseUnits.of(rows)
    assert np.degrees(units.rotation) == pytest.approx(1.0)
    assert units.center_m == pytest.approx(0.04, abs=0.005)


def test_units_follow_the_scale_of_the_world(rows):
    small = replace(rows, points_m=0.01 * rows.points_m, cameras=(rows.cameras[0], 0.01 * rows.cameras[1]))
    units, smaller = PoseUnits.of(rows), PoseUnits.of(small)
    assert smaller.rotation == pytest.approx(units.rotation)
    assert smaller.center_m == pytest.approx(0.01 * units.center_m)


def test_units_shrink_for_a_subject_that_fills_little_of_the_view(rows):
    middle = np.nanmedian(rows.points_m.reshape(-1, 3), axis=0)
    units = PoseUnits.of(replace(rows, points_m=middle + 0.05 * (rows.points_m - middle)))
    assert np.degrees(units.rotation) < 0.2
