"""Occlusion by capsules: known cases, and comparison with sampling."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.kernels.synthetic.occlusion import mark_occluded
from tests.properties import examples

EYE = np.zeros(3)


def hides(point, start, end, radius, *, owner=-1, margin_m=0.05):
    points = np.asarray(point, dtype=float).reshape(1, 1, 1, 3)
    hidden = np.zeros((1, 1, 1), dtype=bool)
    axis = [np.asarray(end_of, dtype=float).reshape(1, 1, 3) for end_of in (start, end)]
    mark_occluded(EYE, points, *axis, np.array([radius]), np.array([owner]), margin_m, hidden)
    return bool(hidden[0, 0, 0])


@pytest.mark.parametrize(
    ("start", "end", "radius", "expected"),
    [
        ((0.2, 3, -1), (0.2, 3, 1), 0.25, True),  # beside the line of sight, but not by its radius
        ((0.2, 3, -1), (0.2, 3, 1), 0.15, False),
        ((0.2, 6, -1), (0.2, 6, 1), 0.25, False),  # behind the point
        ((0.2, -1, -1), (0.2, -1, 1), 0.25, False),  # behind the camera
        ((0, 3, 0.3), (0, 3, 2), 0.25, False),  # ends above the line
        ((0, 3, 0.2), (0, 3, 2), 0.25, True),
        ((0, 1, 0.1), (0, 4, 0.1), 0.2, True),  # along the line of sight
        ((0, 3, 0.1), (0, 3, 0.1), 0.2, True),  # a ball
        ((np.nan, 3, 0), (np.nan, 3, 0), 0.2, False),  # not there
    ],
)
def test_known_cases(start, end, radius, expected):
    assert hides((0, 5, 0), start, end, radius) is expected


def test_own_capsules_and_absent_points_are_not_occluded():
    wall = ((0, 3, -1), (0, 3, 1), 0.5)
    assert hides((0, 5, 0), *wall)
    assert not hides((0, 5, 0), *wall, owner=0)
    assert not hides((np.nan, 5, 0), *wall)


def test_capsules_within_the_margin_do_not_occlude():
    assert not hides((0, 5, 0), (0, 5.05, -1), (0, 5.05, 1), 0.09)
    assert hides((0, 5, 0), (0, 5.05, -1), (0, 5.05, 1), 0.09, margin_m=0.0)


coordinate = st.floats(-2.0, 2.0)
place = st.tuples(coordinate, coordinate, coordinate)


@examples(100)
@given(place, place, place, st.floats(0.05, 0.8))
def test_segment_distances_agree_with_sampling(point, start, end, radius):
    point, start, end = (np.array(p) for p in (point, start, end))
    far = np.linalg.norm(point)
    if far < 0.1:
        return
    u = np.linspace(0, 1, 301)
    sight, axis = u[:, None] * point * (far - 0.05) / far, start + u[:, None] * (end - start)
    gap = np.linalg.norm(sight[:, None] - axis[None], axis=-1).min()
    if abs(gap - radius) > 0.02:
        assert hides(point, start, end, radius) == (gap < radius)
