"""Steps of paths and factors of their covariances, compared with array expressions."""

import numpy as np
import pytest

from posefuse.kernels.trajectory.blocks import to_blocks
from posefuse.kernels.trajectory.path_steps import frame_leverages, limited_factors, take_steps
from tests.unit.kernels.trajectory.dense import UPPER

pytestmark = pytest.mark.no_jit
SHAPE = (2, 19)


def test_steps_are_no_longer_than_the_linear_range():
    rng = np.random.default_rng(0)
    paths, steps = rng.normal(size=(2, *SHAPE, 3))
    steps[1, 3] = 0.0
    moved = np.empty(paths.shape)
    take_steps(paths, to_blocks(steps), 0.5, moved)
    np.testing.assert_allclose(np.linalg.norm(moved - paths, axis=-1).max(), 0.5)
    take_steps(paths, to_blocks(steps), np.inf, moved)
    np.testing.assert_allclose(moved, paths + steps)


def test_leverages_are_a_third_of_the_traces_of_the_products():
    rng = np.random.default_rng(1)
    covariance, information = (each + each.swapaxes(-1, -2) for each in rng.normal(size=(2, *SHAPE, 3, 3)))
    leverage = np.empty(SHAPE)
    frame_leverages(covariance, to_blocks(information[..., *UPPER]), leverage)
    np.testing.assert_allclose(leverage, np.einsum("kfij,kfji->kf", covariance, information) / 3.0)


def test_factors_are_interpolated_and_limited():
    rng = np.random.default_rng(2)
    grid, shares = np.linspace(-2.0, 3.0, 11), rng.uniform(0.5, 1.0, (3, 11))
    single = np.array([0.4, 2.0])
    log_gain, leverage = rng.uniform(-4.0, 5.0, SHAPE), rng.uniform(0.0, 1.5, SHAPE)
    log_gain[0, :3] = -2.0, 3.0, 0.5
    factor = np.empty(SHAPE)
    limited_factors(shares, grid, single, log_gain, leverage, factor)
    usual, errors, motion = (np.interp(log_gain, grid, each) for each in shares)
    expected = np.minimum(single[:, None] * errors + motion, (single[:, None] + motion * usual) / leverage)
    np.testing.assert_allclose(factor, expected)
