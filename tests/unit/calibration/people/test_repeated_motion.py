"""People who repeat what they do, so that the time of a view is confounded with its pose."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.people.match import match_views
from posefuse.calibration.people.views import PeopleViews
from posefuse.errors import CalibrationError
from posefuse.synthetic.motions import HumanMotion
from posefuse.synthetic.rigs import build_rig
from tests.filmed_people import filmed_person, pose_errors

RIG = build_rig("corners", 3)


def steady_walk(radius_m: float, heading: float = 0.4) -> HumanMotion:
    """Return a walk at constant speed along a circle around the room, through its middle after 6 s."""
    angle = heading + 6.0 * 0.9 * 1.3 / radius_m - np.pi / 2
    center = (-radius_m * float(np.cos(angle)), -radius_m * float(np.sin(angle)))
    return HumanMotion(("walk",), 3.0, 0.9, 1.3, radius_m, center, heading, 1.0)


def filmed(motion: HumanMotion, offsets_s: tuple[float, ...] = (0.0, 0.0, 0.0)) -> PeopleViews:
    """Return six seconds of a person in three views."""
    return filmed_person(RIG, np.random.default_rng(1), duration_s=6.0, offsets_s=offsets_s, motion=motion)


@pytest.mark.parametrize("offsets_s", [(0.0, 0.0, 0.0), (0.0, 0.7, -0.5)])
def test_a_straight_walk_does_not_determine_time_offsets(offsets_s):
    with pytest.raises(CalibrationError, match=r"time offset of cam_\d: they walk steadily, .* turns around and stops"):
        match_views(filmed(steady_walk(1e4), offsets_s))


def test_a_walk_in_a_circle_does_not_determine_time_offsets():
    with pytest.raises(CalibrationError, match="they walk steadily"):
        match_views(filmed(steady_walk(2.0)))


def test_a_straight_walk_in_synchronized_views_is_used():
    matched = match_views(replace(filmed(steady_walk(1e4)), max_offset_s=0.0))
    assert np.median(pose_errors(RIG, matched)[0]) < 5.0
    np.testing.assert_allclose(matched.offset_s, 0.0, atol=0.05)


def test_a_person_who_stops_determines_time_offsets():
    motion = replace(steady_walk(1e4), activities=("walk", "turn"))
    matched = match_views(filmed(motion, (0.0, 0.7, -0.5)))
    np.testing.assert_allclose(matched.offset_s, (0.0, 0.7, -0.5), atol=0.05)
