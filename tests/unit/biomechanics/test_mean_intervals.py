"""Intervals of means contain only possible values, and the true mean in about 95 % of samples."""

import numpy as np
import pytest

from posefuse.biomechanics.mean_intervals import (
    MIN_VALUES,
    difference_interval,
    half_width_of_one,
    mean_interval,
    scale_of,
)


def interval_of(name, values):
    scale = scale_of(name, values)
    return mean_interval(values.mean(), values.std(ddof=1) / np.sqrt(len(values)), len(values) - 1, scale)


@pytest.mark.parametrize(("name", "scale"), [("speed_m_s", 1.0), ("stance_percent", 99.0)])
@pytest.mark.parametrize("seed", range(20))
def test_ends_are_possible_and_enclose_the_mean(name, scale, seed):
    values = scale * np.random.default_rng(seed).beta(0.3, 0.3, MIN_VALUES + seed % 3)
    low, high = interval_of(name, values)
    assert 0.0 < low < values.mean() < high
    assert high < (100.0 if name.endswith("_percent") else np.inf)


def test_ends_of_similar_values_are_those_of_the_t_interval():
    values = 50.0 + 0.1 * np.random.default_rng(0).normal(size=12)
    plain = interval_of("height_m", values - 50.0)
    for name in ("stride_time_s", "stance_percent"):
        assert interval_of(name, values) == pytest.approx(np.array(plain) + 50.0, abs=1e-3)


def test_intervals_contain_the_mean_in_95_percent_of_samples():
    rng = np.random.default_rng(1)
    samples = np.exp(0.3 * rng.normal(size=(2000, 6)))
    truth = np.exp(0.5 * 0.3**2)
    ends = np.array([interval_of("step_length_m", each) for each in samples])
    assert ((ends[:, 0] < truth) & (truth < ends[:, 1])).mean() == pytest.approx(0.95, abs=0.02)


def test_equal_values_have_an_interval_of_no_width():
    assert interval_of("flight_percent", np.zeros(5)) == (0.0, 0.0)


def test_a_further_value_is_inside_in_95_percent_of_samples():
    rng = np.random.default_rng(2)
    samples, further = rng.normal(size=(4000, 5)), rng.normal(size=4000)
    half = half_width_of_one(samples.std(axis=1, ddof=1), np.full(4000, 5))
    assert (np.abs(further - samples.mean(axis=1)) < half).mean() == pytest.approx(0.95, abs=0.015)
    assert np.isnan(half_width_of_one(np.ones(3), np.array([1, 2, 3]))).all()


@pytest.mark.parametrize("seed", range(20))
def test_differences_are_antisymmetric_and_at_most_200_percent(seed):
    rng = np.random.default_rng(seed)
    left, right = (rng.gamma(0.2, 1.0, MIN_VALUES + seed % 4) + 1e-6 for _ in range(2))
    value, error, low, high = difference_interval(left, right)
    other = difference_interval(right, left)
    assert -200.0 <= low < value < high <= 200.0
    assert (value, error, low, high) == pytest.approx((-other[0], other[1], -other[3], -other[2]))


def test_differences_of_few_or_not_positive_values_have_no_interval():
    few = difference_interval(np.array([1.0, 1.1, 1.2]), np.ones(9))
    assert np.isfinite(few[:2]).all()
    assert np.isnan(few[2:]).all()
    assert np.isnan(difference_interval(-np.ones(5), np.ones(5))).all()
