"""Band factorization, solution and inverse against the dense matrix."""

import numpy as np
import pytest

from posefuse.kernels.trajectory.band import REACH, factor_paths, invert_paths, solve_paths


def band_of(dense: np.ndarray) -> np.ndarray:
    frames = len(dense) // 3
    band = np.zeros((frames, REACH + 1, 3, 3))
    for f in range(frames):
        for m in range(min(REACH, f) + 1):
            band[f, m] = dense[3 * f : 3 * f + 3, 3 * (f - m) : 3 * (f - m) + 3]
    return band


def random_path(rng: np.random.Generator, frames: int) -> np.ndarray:
    """Return a matrix of frames with one view each, coupled by third differences a thousand times as strong."""
    rows = np.zeros((max(frames - 3, 0), frames))
    for row in range(len(rows)):
        rows[row, row : row + 4] = (-1.0, 3.0, -3.0, 1.0)
    dense = 1e3 * np.kron(rows.T @ rows, np.eye(3)) + 1e-6 * np.eye(3 * frames)
    for f in range(frames):
        view = rng.standard_normal((2, 3))
        dense[3 * f : 3 * f + 3, 3 * f : 3 * f + 3] += view.T @ view
    return dense


@pytest.mark.parametrize("frames", [1, 2, 4, 150])
def test_band_matches_the_dense_matrix(frames):
    rng = np.random.default_rng(frames)
    dense = np.stack([random_path(rng, frames) for _ in range(2)])
    band = np.stack([band_of(each) for each in dense])
    lower, inverse, logs = np.empty((2, frames, REACH, 3, 3)), np.empty((2, frames, 3, 3)), np.empty(2)
    factor_paths(band, lower, inverse, logs)
    assert np.allclose(logs, np.linalg.slogdet(dense)[1], rtol=1e-9, atol=1e-6)
    right = rng.standard_normal((2, frames, 3))
    found = right.copy()
    solve_paths(lower, inverse, found)
    expected = np.stack([np.linalg.solve(a, b.ravel()).reshape(-1, 3) for a, b in zip(dense, right, strict=True)])
    assert np.allclose(found, expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max())
    covariance = np.zeros_like(band)
    invert_paths(lower, inverse, covariance)
    expected = np.stack([band_of(np.linalg.inv(each)) for each in dense])
    assert np.allclose(covariance, expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max())
