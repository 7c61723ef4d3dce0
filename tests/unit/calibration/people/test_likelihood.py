"""Comparison of explanations of the same bodies."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.people.bearings import bearings_of
from posefuse.calibration.people.bodies import bones_of, sample_bodies
from posefuse.calibration.people.body_bundle import initial_state
from posefuse.calibration.people.likelihood import SIGNIFICANT, advantage, body_costs, camera_costs
from posefuse.model.cameras import rotation_from_vector
from posefuse.synthetic.rigs import build_rig
from tests.filmed_people import filmed_person


@pytest.mark.parametrize("costs_of", [body_costs, camera_costs])
def test_true_cameras_are_significantly_more_probable(rng, costs_of):
    rig = build_rig("ring", 3)
    people = filmed_person(rig, rng)
    views = [bearings_of(view, people.skeleton) for view in people.views]
    bones = bones_of(people.skeleton, views[0].keypoints)
    samples = sample_bodies(views, [[0, 0, 0]], np.zeros(3), np.ones(3), 40)
    rotations = np.stack([camera.rotation for camera in rig.cameras])
    centers = np.stack([camera.center_m for camera in rig.cameras])
    true = initial_state(samples, bones, rotations, centers)
    turned = replace(true, rotations=rotation_from_vector(np.array([0.0, 0.05, 0.0])) @ true.rotations)
    costs, others = costs_of(samples, bones, true), costs_of(samples, bones, turned)
    assert costs.shape == samples.observed.shape[:3:2]
    assert advantage(costs, others, samples.time_s) > SIGNIFICANT
    assert advantage(others, costs, samples.time_s) < -SIGNIFICANT
    larger = replace(
        true, centers=2.0 * true.centers, points=2.0 * true.points, log_lengths=true.log_lengths + np.log(2.0)
    )
    np.testing.assert_allclose(costs_of(samples, bones, larger).sum(), costs.sum(), rtol=1e-6)


def test_evidence_of_one_keypoint_or_one_second_is_not_significant():
    time_s, none = np.linspace(0.0, 20.0, 100), np.zeros((100, 12))
    of_keypoint, of_second, of_all = none.copy(), none.copy(), none + 1.0
    of_keypoint[:, 3] = 5.0
    of_second[40:44] = 5.0
    of_all[::2] += 1.0
    assert advantage(none, of_keypoint, time_s) == pytest.approx(1.0, abs=0.1)
    assert advantage(none, of_second, time_s) < SIGNIFICANT
    assert advantage(none, of_all, time_s) > SIGNIFICANT
    assert advantage(none, none, time_s) == 0.0
