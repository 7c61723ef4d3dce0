"""Self-consistency of results against hand computations and a simulated recording."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.evaluation.self_consistency import self_consistency
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from tests.people import simulate_walkers, track_perfectly


@pytest.fixture(scope="module")
def result():
    return track_perfectly(simulate_walkers())


def test_innovations_match_hand_computed_values(result):
    shape = (result.n_frames, len(result.person_ids))
    nis, dof = np.full(shape, np.nan), np.zeros(shape, dtype=np.int32)
    nis[:3, 0], dof[:3, 0] = (10.0, 20.0, 90.0), (20, 20, 20)
    nis[0, 1], dof[0, 1] = 80.0, 40
    scores = self_consistency(replace(result, poses=replace(result.poses, nis=nis, nis_dof=dof)))
    assert (scores.innovations.n_keypoints, scores.innovations.mean) == (50, 2.0)
    assert scores.innovations.median == 1.5
    first, second, third = (person.innovations for person in scores.people[:3])
    assert (first.mean, first.median) == (2.0, 1.0)
    assert second.median == 2.0
    assert third is None


def test_people_are_evaluated_separately(result):
    scores = self_consistency(result)
    points = np.asarray(result.layers["model"].points_m)
    assert scores.layer == "model"
    for p, person in enumerate(scores.people):
        assert person.n_frames == np.isfinite(points[:, p]).any(axis=(1, 2)).sum()
        assert person.missing_share == 0.0
        assert 0.0 < person.bone_variation < 0.2
    assert scores.acceleration_m_s2 > 1.0


def test_no_values_without_tracked_people(result):
    assert self_consistency(replace(result, poses=None)).innovations is None


def test_innovations_are_inverse_to_the_squared_noise_scale():
    scene = simulate_crowd(CrowdOptions(people=1, duration_s=3.0, seed=0, skeleton="body_20"))
    messages = {}
    for scale_px in (9.0, 18.0):
        options = Options(people="many", noise_scale_px=scale_px, tracker=TrackerOptions(smoother="none"))
        actual = reconstruct(scene.rig, scene.detections, options)
        dof = np.asarray(actual.poses.nis_dof)
        assert (np.isfinite(np.asarray(actual.poses.nis)) == (dof > 0)).all()
        assert dof.max() <= 2 * len(scene.rig) * len(actual.skeleton)
        messages[scale_px] = self_consistency(actual).innovations.median
    assert 2.0 < messages[9.0] / messages[18.0] < 4.5
