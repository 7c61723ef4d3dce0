"""Assignment of people to the truth."""

import math

import numpy as np

from posefuse.evaluation.matching import assign, match_identities, mean_distances_m
from tests.unit.evaluation.test_identity import walkers

FRAMES = 20


def test_assignment_maximizes_the_number_of_pairs():
    """A greedy assignment would take the closest pair only."""
    apart = np.array([[0.1, 0.4], [0.2, 9.0]])
    rows, columns = assign(apart, apart <= 0.5)
    assert dict(zip(rows.tolist(), columns.tolist(), strict=True)) == {0: 1, 1: 0}


def test_missing_keypoints_are_left_out_of_distances():
    truth = walkers(1)
    points = truth + np.array([0.3, 0, 0])
    points[:, :, 1] = np.nan
    points[5, :, 0] = np.nan
    points[6] = np.nan
    apart = mean_distances_m(points, truth)[:, 0, 0]
    assert math.isnan(apart[6])
    np.testing.assert_allclose(np.delete(apart, 6), 0.3)


def test_every_track_is_matched_to_one_person():
    truth = walkers(2)
    points = truth[:, ::-1].copy()
    points[:5] = truth[:5]
    person, together = match_identities(mean_distances_m(points, truth))
    assert person.tolist() == [1, 0]
    assert together.tolist() == [[5, 15], [15, 5]]
