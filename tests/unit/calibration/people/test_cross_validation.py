"""Rigs that do not predict held-out observations better than observations at wrong times."""

import numpy as np
import pytest

from posefuse.calibration.people.assemble import Assembly, assemble
from posefuse.calibration.people.bearings import Bearings, bearings_of
from posefuse.calibration.people.bodies import BodySamples, Bones, bones_of, sample_bodies
from posefuse.calibration.people.cross_validation import (
    at_wrong_times,
    check_prediction,
    prediction_advantage,
)
from posefuse.calibration.people.likelihood import SIGNIFICANT
from posefuse.calibration.people.match import match_views
from posefuse.calibration.people.pairs import relate_pair
from posefuse.errors import CalibrationError
from posefuse.synthetic.rigs import build_rig
from tests.filmed_people import filmed_person

KNOWN = np.array([True, True])


def assembled_pair(second_seed: int) -> tuple[list[Bearings], Bones, Assembly]:
    """Return two views of a person, the second of another one unless the seed is 0, and how they are related best."""
    rig = build_rig("corners", 2)
    films = [filmed_person(rig, np.random.default_rng(seed), duration_s=10.0) for seed in (0, second_seed)]
    skeleton = films[0].skeleton
    views = [bearings_of(film.views[v], skeleton) for v, film in enumerate(films)]
    bones = bones_of(skeleton, views[0].keypoints)
    samples = sample_bodies(views, [[0, 0]], np.zeros(2), np.ones(2), 60)
    edges = {(0, 1): relate_pair(views[0], views[1], offsets_s=[0.0])}
    return views, bones, assemble(samples, bones, edges, KNOWN, True)[0]


def test_views_of_one_person_predict_each_other():
    views, bones, assembly = assembled_pair(0)
    assert prediction_advantage(assembly, bones, KNOWN) > SIGNIFICANT
    check_prediction(views, bones, KNOWN, assembly)


@pytest.mark.parametrize("seed", [3, 4])
def test_views_of_different_people_do_not_predict_each_other(seed):
    views, bones, assembly = assembled_pair(seed)
    with pytest.raises(CalibrationError, match="cam_0, cam_1: .* hardly better than at wrong times"):
        check_prediction(views, bones, KNOWN, assembly)


@pytest.mark.long
def test_noisy_detections_of_a_standing_person_do_not_determine_three_cameras():
    people = filmed_person(
        build_rig("corners", 3), np.random.default_rng(2), activities=("stand", "reach"), sigma_px=15.0
    )
    with pytest.raises(CalibrationError, match="hardly better than at wrong times"):
        match_views(people)


def test_wrong_times_keep_people_apart():
    observed = np.arange(7.0)[:, None, None, None] * np.ones((7, 2, 3, 10))
    observed[4, 1] = np.nan
    samples = BodySamples(np.arange(7.0), np.array([0, 0, 0, 0, 1, 1, 1]), observed, np.arange(3))
    later = at_wrong_times(samples, 1, 0.25, False).observed[..., 0, 0]
    np.testing.assert_array_equal(later[:, 0], np.arange(7.0))
    np.testing.assert_array_equal(later[:, 1], [3, 0, 1, 2, np.nan, 5, 6])
    np.testing.assert_array_equal(
        at_wrong_times(samples, 1, 0.5, True).observed[:, 1, 0, 0], [1, 0, 3, 2, np.nan, 5, 6]
    )
