"""The common factor of unknown focal lengths."""

from dataclasses import replace

import numpy as np
from benchmarks.calibration_scores import score_calibration
from benchmarks.simulated_rigs import random_options, simulate_rig

from posefuse.calibration.people.assemble import free_parameters
from posefuse.calibration.people.bearings import bearings_of
from posefuse.calibration.people.bodies import bones_of, sample_bodies
from posefuse.calibration.people.body_bundle import initial_state
from posefuse.calibration.people.common_focal import with_common_focal
from posefuse.calibration.people.match import match_views
from posefuse.calibration.people.tracks import tracks_in_views
from posefuse.synthetic.rigs import build_rig
from tests.filmed_people import filmed_person

GUESS = 1.35


def test_search_ends_near_the_true_focal_length(rng):
    rig = build_rig("corners", 4)
    people = filmed_person(rig, rng, duration_s=6.0)
    views = []
    for view in people.views:
        matrix = view.camera.matrix.copy()
        matrix[:2, :2] *= GUESS
        views.append(bearings_of(replace(view, camera=replace(view.camera, matrix=matrix)), people.skeleton))
    samples = sample_bodies(views, [[0] * 4], np.zeros(4), np.ones(4), 30)
    bones = bones_of(people.skeleton, views[0].keypoints)
    free = free_parameters(np.zeros(4, dtype=bool), False)
    rotations, centers = (np.stack([getattr(c, name) for c in rig.cameras]) for name in ("rotation", "center_m"))
    found = with_common_focal(samples, bones, initial_state(samples, bones, rotations, centers), free)
    np.testing.assert_allclose(np.exp(found.log_focal) * GUESS, 1.0, atol=0.2)
    assert np.ptp(found.log_focal) == 0.0


def test_standing_person_does_not_shorten_focal_lengths():
    """Near and wide views let bones absorb errors: lenses were at a third of their length, cameras 17 degrees off."""
    case = simulate_rig(random_options(416))
    matched = match_views(tracks_in_views(case.detections, case.lenses(focal_known=False).cameras, False), 416)
    score = score_calibration([view.camera for view in matched.views], case.rig)
    assert score.rotation_deg < 6.0
    assert score.focal < 0.35
