"""Whether the noise of cameras differs, decided by left-out views."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posefuse.noise.camera_factors import camera_factors
from posefuse.noise.factor_choice import factors_by_prediction
from posefuse.noise.leave_one_out import LeaveOneOutPoints
from posefuse.triangulation.linearized import LinearPoints

_FRAMES, _KEYPOINTS = 60, 15


def _found(rng, scale_px, lasting_px=0.0):
    """Return points that cameras see from random directions.

    Args:
        rng: random numbers.
        scale_px: shape (view,): errors that differ in every frame.
        lasting_px: errors of each keypoint and view that are the same in all frames.
    """
    views = len(scale_px)
    shape = (_FRAMES, _KEYPOINTS, views, 2)
    errors = np.asarray(scale_px)[:, None] * rng.standard_normal(shape) + lasting_px * rng.standard_normal(shape[1:])
    directions = np.broadcast_to(rng.standard_normal((_KEYPOINTS, views, 2, 3)), (*shape, 3))
    n = _FRAMES * _KEYPOINTS
    points = LinearPoints(errors.reshape(n, views, 2), 100.0 * directions.reshape(n, views, 2, 3))
    frame, column = np.divmod(np.arange(n), _KEYPOINTS)
    sigma = np.full((n, views), 2.0)
    return LeaveOneOutPoints(points, np.ones((n, views), dtype=bool), sigma, np.ones((n, views)), frame, column)


@pytest.mark.parametrize("views", [3, 4, 6])
def test_noise_differs_where_a_camera_has_larger_errors(views, rng):
    scale = np.full(views, 2.0)
    scale[1] = 6.0
    found = _found(rng, scale)
    factor = camera_factors(found.points, found.sigma_px)
    np.testing.assert_array_equal(factors_by_prediction(found, factor), factor)


@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 1000))
def test_noise_stays_equal_where_wrong_factors_are_proposed(seed):
    rng = np.random.default_rng(seed)
    found = _found(rng, [2.0] * 4)
    wrong = np.exp(rng.choice([-0.5, 0.5], 4) * rng.uniform(0.5, 1.5))
    assert (factors_by_prediction(found, wrong / wrong.mean() * [1.0, 1.0, 1.0, 1.2]) == 1.0).all()


def test_lasting_errors_of_few_keypoints_do_not_show_unequal_cameras():
    """If frames counted as independent, chance would decide."""
    chosen = 0
    for seed in range(20):
        found = _found(np.random.default_rng(seed), [0.2] * 3, lasting_px=4.0)
        chosen += np.ptp(factors_by_prediction(found, camera_factors(found.points, found.sigma_px))) > 0.0
    assert chosen <= 4


def test_points_in_two_views_keep_equal_noise(rng):
    found = _found(rng, [2.0, 6.0])
    assert (factors_by_prediction(found, np.array([0.6, 1.6])) == 1.0).all()


def test_equal_factors_are_returned(rng):
    found = _found(rng, [2.0] * 3)
    assert (factors_by_prediction(found, np.ones(3)) == 1.0).all()
