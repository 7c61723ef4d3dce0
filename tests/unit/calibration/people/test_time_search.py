"""Candidates for the time offset of two views."""

import pytest

from posefuse.calibration.people.bearings import bearings_of
from posefuse.calibration.people.time_search import GRID_S, offset_candidates
from posefuse.synthetic.rigs import build_rig
from tests.filmed_people import filmed_person


@pytest.mark.parametrize("offset_s", [0.0, 0.83, -1.42])
def test_offset_is_the_first_candidate(rng, offset_s):
    people = filmed_person(
        build_rig("corners", 2), rng, offsets_s=(0.0, offset_s), rates_hz=(25.0, 30.0), duration_s=9.0
    )
    a, b = (bearings_of(view, people.skeleton) for view in people.views)
    found = offset_candidates(a, b, ((0, 0),), 2.0, 1.0, 4)
    assert abs(found[0] - offset_s) <= GRID_S
    assert any(abs(candidate) < GRID_S for candidate in found)
    assert len(found) <= 4


def test_costs_that_fall_beyond_the_largest_offset_have_no_minimum_there(rng):
    people = filmed_person(build_rig("corners", 2), rng, offsets_s=(0.0, 1.15), duration_s=9.0)
    a, b = (bearings_of(view, people.skeleton) for view in people.views)
    assert max(offset_candidates(a, b, ((0, 0),), 1.0, 1.0, 4)) < 0.9
