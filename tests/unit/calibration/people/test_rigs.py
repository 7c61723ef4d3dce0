"""Time offsets of assembled rigs."""

import numpy as np

from posefuse.calibration.people.assemble import assemble
from posefuse.calibration.people.bearings import bearings_of
from posefuse.calibration.people.bodies import bones_of, sample_bodies
from posefuse.calibration.people.match import RigSearch, best_rig
from posefuse.calibration.people.pairs import relate_pair
from posefuse.calibration.people.rigs import later, with_exact_times
from posefuse.synthetic.rigs import build_rig
from tests.filmed_people import filmed_person


def test_offsets_are_relative_to_the_first_view(rng):
    people = filmed_person(build_rig("ring", 3), rng, offsets_s=(0.0, 0.05, -0.08), duration_s=5.0)
    views = [bearings_of(view, people.skeleton) for view in people.views]
    bones = bones_of(people.skeleton, views[0].keypoints)
    rig = best_rig(views, [[0, 0, 0]], bones, np.ones(3, dtype=bool), RigSearch(people.max_offset_s))
    assert rig is not None
    exact = with_exact_times(views, [[0, 0, 0]], bones, np.ones(3, dtype=bool), rig)
    np.testing.assert_allclose(exact.offset_s, [0.0, 0.05, -0.08], atol=0.01)
    assert later(exact.offset_s, exact.assembly)[0] == 0.0


def test_views_that_share_no_time_are_not_assembled(rng):
    people = filmed_person(build_rig("ring", 2), rng, duration_s=5.0)
    views = [bearings_of(view, people.skeleton) for view in people.views]
    samples = sample_bodies(views, [[0, 0]], np.array([0.0, 9.0]), np.ones(2), 60)
    edges = {(0, 1): relate_pair(views[0], views[1], offsets_s=[0.0])}
    assert assemble(samples, bones_of(people.skeleton, views[0].keypoints), edges, np.ones(2, dtype=bool), True) == []
