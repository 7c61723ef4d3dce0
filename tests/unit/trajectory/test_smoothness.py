"""Finite differences, and the frames where a path is defined."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.trajectory.smoothness import ORDERS, Smoothness, alive_frames, density_for_time_constant, time_constant_s
from tests.properties import examples


@pytest.mark.parametrize("prior", ["jerk", "acceleration"])
def test_differences_are_derivatives_for_irregular_times(prior):
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.005, 0.05, 40))
    order = ORDERS[prior]
    smoothness = Smoothness.of(prior, t)
    for power, derivative in ((order, np.prod(np.arange(1, order + 1))), (order - 1, 0.0)):
        path = np.append(t**power, np.zeros(3))
        actual = [smoothness.differences[r] @ path[r : r + 4] for r in range(len(smoothness.time_s))]
        assert np.allclose(actual, derivative, atol=1e-4)


def test_time_shares_of_rows_add_up():
    t = np.cumsum(np.random.default_rng(1).uniform(0.005, 0.05, 2000))
    assert Smoothness.of("jerk", t).time_s.sum() == pytest.approx(t[-1] - t[0], rel=0.01)


def test_path_covers_short_gaps_but_not_its_ends():
    t = np.arange(10) / 10.0
    visible = np.array([[0, 1, 0, 0, 1, 0, 0, 0, 1, 0]], dtype=bool)
    alive = alive_frames(visible, t, 0.2)
    assert alive[0].astype(int).tolist() == [0, 1, 1, 1, 1, 0, 0, 0, 1, 0]


@examples(50)
@given(st.lists(st.booleans(), min_size=2, max_size=30))
def test_reversed_time_gives_the_same_alive_frames(frames):
    observed = np.array([frames])
    t = np.arange(len(frames)) / 30.0
    forward, backward = alive_frames(observed, t, 0.1), alive_frames(observed[:, ::-1], t, 0.1)
    assert np.array_equal(forward, backward[:, ::-1])


def test_time_constants_and_densities_are_inverse():
    density = density_for_time_constant(0.01, np.array([1e-4, 4e-4]), 0.05, 3)
    assert np.allclose(time_constant_s(0.01, np.array([1e-4, 4e-4]), density, 3), 0.05)


def test_density_factor_is_one_for_expected_differences_and_follows_others():
    smoothness = Smoothness.of("jerk", np.arange(203) / 100.0)
    reference, squares = np.ones((1, 200)), np.ones((1, 200))
    assert np.allclose(smoothness.local_density_factor(squares, reference, 21, 10.0), 1.0)
    squares[:, 100:] = 50.0
    actual = smoothness.local_density_factor(squares, reference, 21, 1.0)[0]
    assert actual[:80] == pytest.approx(1.0)
    assert actual[130] > 40.0
    assert (np.diff(actual) > -1e-9).all()
