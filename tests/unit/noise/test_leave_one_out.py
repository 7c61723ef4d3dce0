"""Pairs of residuals."""

import numpy as np

from posefuse.noise.leave_one_out import LeaveOneOutPoints, choose_pairs
from posefuse.triangulation.linearized import LinearPoints


def test_pairs_stay_within_their_piece():
    """A pair joins a point with the next frame if that is informative and in the same piece."""
    telling = np.ones((6, 1, 2), dtype=bool)
    telling[1, 0, 0] = False
    pairs = choose_pairs(telling, (0, 4), 100).reshape(-1, 2).tolist()
    assert pairs == [[0, 0], [1, 3], [3, 5], [4, 6], [5, 7], [6, 6], [7, 7], [8, 10], [9, 11], [10, 10], [11, 11]]
    few = choose_pairs(telling, (0, 4), 2).reshape(-1, 2)[:, 0].tolist()
    assert few == [0, 7, 8, 11]
    assert choose_pairs(np.zeros((3, 1, 2), dtype=bool), (0, 1), 5).tolist() == []


def test_fewer_points_contain_the_same_ones_if_some_are_missing():
    frame, column = np.divmod(np.arange(600), 6)
    ones = np.ones((600, 3))
    points = LinearPoints(np.ones((600, 3, 2)), np.ones((600, 3, 2, 3)))
    found = LeaveOneOutPoints(points, ones > 0, ones, ones, frame, column)
    few = found.take(60)
    assert (len(few.frame), len(few.points.residuals_px), len(few.sigma_px)) == (60, 60, 60)
    assert set(few.column) == set(range(6))
    rest = np.arange(600) % 10 > 0
    points = LinearPoints(points.residuals_px[rest], points.jacobians[rest])
    fewer = LeaveOneOutPoints(points, ones[rest] > 0, ones[rest], ones[rest], frame[rest], column[rest]).take(60)
    both = set(zip(few.frame, few.column, strict=True)) & set(zip(fewer.frame, fewer.column, strict=True))
    assert len(both) >= 50
    assert len(found.take(600).frame) == 600
