"""Terms of the smoothness prior, compared with dense matrices."""

import numpy as np
import pytest

from posefuse.kernels.trajectory.blocks import empty_blocks, from_blocks, matrices_from_blocks, n_blocks, to_blocks
from posefuse.kernels.trajectory.observation_terms import PathSystem
from posefuse.kernels.trajectory.smoothness_terms import (
    SCRATCH_ROWS,
    SmoothnessTerms,
    add_smoothness,
    padded_coefficients,
    squared_differences,
)
from posefuse.trajectory.smoothness import Smoothness
from tests.unit.kernels.trajectory.dense import UPPER

pytestmark = pytest.mark.no_jit
KEYPOINTS = 2


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 16, 20])
@pytest.mark.parametrize("prior", ["jerk", "acceleration"])
def test_terms_are_those_of_squared_differences(frames, prior):
    rng = np.random.default_rng(frames)
    smoothness = Smoothness.of(prior, np.sort(rng.uniform(0.0, 10.0, frames)))
    rows = len(smoothness.time_s)
    stiffness, ridge = rng.uniform(0.0, 2.0, (KEYPOINTS, rows)), rng.uniform(0.1, 1.0, KEYPOINTS)
    if rows:
        stiffness[1, -1] = 0.0
    paths = rng.normal(size=(KEYPOINTS, frames, 3))
    roots = rng.normal(size=(KEYPOINTS, frames, 3, 3))
    information = roots @ roots.swapaxes(-1, -2)
    system = PathSystem(
        empty_blocks(KEYPOINTS, frames, 6),
        empty_blocks(KEYPOINTS, frames, 3),
        to_blocks(np.ones((KEYPOINTS, frames, 3))),
        to_blocks(information[..., *UPPER]),
    )
    coefficients = padded_coefficients(smoothness.differences, n_blocks(frames))
    terms = SmoothnessTerms(coefficients, stiffness, np.zeros((SCRATCH_ROWS, coefficients.shape[1])))
    add_smoothness(terms, ridge, paths, system)
    matrix = np.zeros((rows, frames))
    for row in range(rows):
        reach = min(4, frames - row)
        matrix[row, row : row + reach] = smoothness.differences[row, :reach]
    diagonal, coupling = matrices_from_blocks(system.diagonal, frames), from_blocks(system.coupling, frames)
    covariance = np.einsum("kfi,kgi->kfg", *[rng.normal(size=(KEYPOINTS, frames, 5))] * 2)
    traces = np.full((KEYPOINTS, 4, frames), np.nan)
    for m in range(min(4, frames)):
        traces[:, m, : frames - m] = np.diagonal(covariance, m, axis1=1, axis2=2)
    squares, determined = np.empty((KEYPOINTS, rows)), np.empty((KEYPOINTS, rows))
    squared_differences(terms, paths, traces, squares, determined)
    for k in range(KEYPOINTS):
        dense = matrix.T @ (stiffness[k][:, None] * matrix)
        own = information[k] + (np.diag(dense) + ridge[k])[:, None, None] * np.eye(3)
        np.testing.assert_allclose(diagonal[k], own)
        for m in (1, 2, 3):
            expected = np.append(np.zeros(min(m, frames)), np.diag(dense, -m) if m < frames else [])
            np.testing.assert_allclose(coupling[k, :, m - 1], expected, atol=1e-9)
        np.testing.assert_allclose(from_blocks(system.rhs, frames)[k], 1.0 - dense @ paths[k], rtol=1e-6, atol=1e-6)
        difference = matrix @ paths[k]
        np.testing.assert_allclose(squares[k], stiffness[k] * np.square(difference).sum(axis=1))
        variance = stiffness[k] * np.einsum("rf,fg,rg->r", matrix, covariance[k], matrix)
        np.testing.assert_allclose(
            determined[k], np.where(stiffness[k] > 0.0, np.clip(3.0 - variance, 0.0, 3.0), 0.0), atol=1e-6
        )
