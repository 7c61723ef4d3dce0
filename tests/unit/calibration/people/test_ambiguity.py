"""People who do not determine the cameras, and searches that must not end in a worse minimum."""

import numpy as np
import pytest

from posefuse.calibration.people.match import match_views
from posefuse.errors import CalibrationError
from posefuse.synthetic.rigs import build_rig
from tests.filmed_people import filmed_person, pose_errors


def test_standing_person_does_not_determine_two_distant_cameras():
    people = filmed_person(build_rig("ring", 2), np.random.default_rng(3), activities=("stand", "reach"), sigma_px=15.0)
    with pytest.raises(CalibrationError, match=r"two calibrations that differ by \d+ degrees .* turns around"):
        match_views(people)


def test_most_probable_start_is_used():
    """Poses that leave small residuals with bones of changing lengths are not the best."""
    rig = build_rig("corners", 5)
    people = filmed_person(rig, np.random.default_rng(3), activities=("stand", "reach"), sigma_px=15.0)
    assert np.median(pose_errors(rig, match_views(people))[0]) < 8.0
