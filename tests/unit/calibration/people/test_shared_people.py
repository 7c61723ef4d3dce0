"""Tracks of the same people in two views, without a calibration."""

import numpy as np
import pytest

from posefuse.calibration.people.bearings import bearings_of
from posefuse.calibration.people.shared_people import exclusive_matches, shared_people
from posefuse.model.cameras import vector_from_rotation
from tests.unit.calibration.people.crowd_views import crowd_views


@pytest.fixture(scope="module")
def crowd():
    return crowd_views(3, people=3, cameras=3)


@pytest.mark.parametrize("pair", [(0, 1), (1, 2)])
def test_people_offset_and_pose_are_found_together(crowd, pair):
    a, b = (bearings_of(crowd.people.views[v], crowd.people.skeleton) for v in pair)
    found = shared_people(a, b, max_offset_s=2.0)
    assert found is not None
    owners = [(crowd.owner[pair[0]][i], crowd.owner[pair[1]][j]) for i, j in found.matches]
    assert np.mean([one == other for one, other in owners]) > 0.9
    assert {one for one, _ in owners} >= {0, 1, 2}
    assert found.explained > 0.6
    assert found.geometry.offset_s == pytest.approx(crowd.offset_s[pair[1]] - crowd.offset_s[pair[0]], abs=0.1)
    first, second = (crowd.rig.cameras[v].rotation for v in pair)
    turn = vector_from_rotation(found.geometry.rotation @ first @ second.T)
    assert np.degrees(np.linalg.norm(turn)) < 25.0
    assert all(crowd.owner[pair[0]][i] != crowd.owner[pair[1]][j] for i, j in found.different)


def test_partners_at_the_same_time_are_exclusive():
    support = np.array([[5.0, 4.0], [4.5, 1.0]])
    never, always = np.zeros((2, 2)), np.full((2, 2), 100.0)
    assert exclusive_matches(support, always, always) == [(0, 0), (1, 1)]
    assert exclusive_matches(support, never, always) == [(0, 0), (1, 0), (0, 1), (1, 1)][:2]
    assert set(exclusive_matches(support, never, never)) == {(0, 0), (0, 1), (1, 0), (1, 1)}
    assert exclusive_matches(np.zeros((2, 2)), never, never) == []
