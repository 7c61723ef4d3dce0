"""The prior that finite differences over neighboring frames are small, in the trajectory system.

Arrays of numbers per keypoint and frame are in blocks, see :mod:`posefuse.kernels.trajectory.blocks`.
"""

from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.jit import disjoint, kernel
from posefuse.kernels.trajectory.band import REACH

SCRATCH_ROWS = 10
"""Rows of scratch arrays: four of numbers per row of the prior or per frame, the differences, and the coordinates."""

_DIFFERENCES = 4
_PATH = 7


class SmoothnessTerms(NamedTuple):
    """Smoothness prior of all paths.

    Attributes:
        coefficients: shape (REACH + 1, n): coefficients of frames ``row`` to ``row + REACH`` at ``REACH + row``; 0
            before the first row and after the last, up to the end of the last block of frames.
        stiffness: shape (keypoint, row): inverse of the expected variance of the result of a row.
        scratch: shape (SCRATCH_ROWS, n), 0.
    """

    coefficients: Any
    stiffness: Any
    scratch: Any


def padded_coefficients(differences: np.ndarray, blocks: int) -> np.ndarray:
    """Return the coefficients of SmoothnessTerms for finite differences of shape (row, REACH + 1)."""
    coefficients = np.zeros((REACH + 1, REACH + BLOCK * blocks))
    coefficients[:, REACH : REACH + len(differences)] = differences.T
    return coefficients


@disjoint
def _deviate(coefficients, path, n_rows, scratch):
    """Write the coordinates and the finite differences of a path, shape (frame, 3), to ``scratch``."""
    for i in range(3):
        for f in range(path.shape[0]):
            scratch[_PATH + i, f] = path[f, i]
        for r in range(n_rows):
            n = REACH + r
            scratch[_DIFFERENCES + i, n] = (
                coefficients[0, n] * scratch[_PATH + i, r]
                + coefficients[1, n] * scratch[_PATH + i, r + 1]
                + coefficients[2, n] * scratch[_PATH + i, r + 2]
                + coefficients[3, n] * scratch[_PATH + i, r + 3]
            )


@disjoint
def _sum_rows(coefficients, scratch, first, out):
    """Sum the rows that contain each frame of a block: own matrix, coupling with the three frames before, gradient."""
    for j in range(BLOCK):
        n = REACH + first + j
        w0 = scratch[0, n]
        w1 = scratch[1, n - 1]
        w2 = scratch[2, n - 2]
        w3 = scratch[3, n - 3]
        out[j] = w0 * coefficients[0, n] + w1 * coefficients[1, n - 1]
        out[j] += w2 * coefficients[2, n - 2] + w3 * coefficients[3, n - 3]
        out[BLOCK + j] = w1 * coefficients[0, n - 1] + w2 * coefficients[1, n - 2] + w3 * coefficients[2, n - 3]
        out[2 * BLOCK + j] = w2 * coefficients[0, n - 2] + w3 * coefficients[1, n - 3]
        out[3 * BLOCK + j] = w3 * coefficients[0, n - 3]
        for i in range(3):
            m = _DIFFERENCES + i
            gradient = w0 * scratch[m, n] + w1 * scratch[m, n - 1] + w2 * scratch[m, n - 2]
            out[(4 + i) * BLOCK + j] = gradient + w3 * scratch[m, n - 3]


@kernel
def add_smoothness(smoothness, ridge, paths, system):
    """Write the matrix of views and smoothness, and add the gradient of smoothness.

    Args:
        smoothness: SmoothnessTerms.
        ridge: shape (keypoint,): small information that ties each point to its current position.
        paths: shape (keypoint, frame, 3).
        system: PathSystem; the diagonal and the coupling are written, and the right-hand side is added to.
    """
    coefficients, stiffness, scratch = smoothness
    diagonal, coupling, rhs, information = system
    sums = np.empty(7 * BLOCK)
    for k in range(paths.shape[0]):
        _deviate(coefficients, paths[k], stiffness.shape[1], scratch)
        for a in range(REACH + 1):
            for r in range(stiffness.shape[1]):
                scratch[a, REACH + r] = stiffness[k, r] * coefficients[a, REACH + r]
        for b in range(diagonal.shape[1]):
            _sum_rows(coefficients, scratch, b * BLOCK, sums)
            for i in range(6):
                on_diagonal = i == 0 or i == 3 or i == 5
                for j in range(BLOCK):
                    own = sums[j] + ridge[k] if on_diagonal else 0.0
                    diagonal[k, b, i * BLOCK + j] = information[k, b, i * BLOCK + j] + own
            for i in range(3):
                for j in range(BLOCK):
                    coupling[k, b, i * BLOCK + j] = sums[(1 + i) * BLOCK + j]
                    rhs[k, b, i * BLOCK + j] -= sums[(4 + i) * BLOCK + j]


@disjoint
def _predict_rows(coefficients, traces, variance):
    """Write the variance of each finite difference of one path, summed over its three components.

    Args:
        coefficients: shape (REACH + 1, REACH + row).
        traces: shape (SCRATCH_ROWS, frame): first those of the blocks of the covariance that couple each frame with
            itself and with the next three.
        variance: shape (row,), written.
    """
    for r in range(variance.shape[0]):
        c0 = coefficients[0, REACH + r]
        c1 = coefficients[1, REACH + r]
        c2 = coefficients[2, REACH + r]
        c3 = coefficients[3, REACH + r]
        total = c0 * c0 * traces[0, r] + c1 * c1 * traces[0, r + 1]
        total += c2 * c2 * traces[0, r + 2] + c3 * c3 * traces[0, r + 3]
        total += 2.0 * (c0 * c1 * traces[1, r] + c1 * c2 * traces[1, r + 1] + c2 * c3 * traces[1, r + 2])
        variance[r] = total + 2.0 * (c0 * c2 * traces[2, r] + c1 * c3 * traces[2, r + 1] + c0 * c3 * traces[3, r])


@kernel
def squared_differences(smoothness, paths, traces, squares, determined):
    """Compute squared finite differences of the paths, and how many of their components the data determine.

    Args:
        smoothness: SmoothnessTerms.
        paths: shape (keypoint, frame, 3).
        traces: shape (keypoint, REACH + 1, frame), from
            :func:`posefuse.kernels.trajectory.band_inverse.invert_paths`.
        squares: shape (keypoint, row), written: squared difference in units of the expected variance.
        determined: shape (keypoint, row), written: number of the 3 components that the data determine.
    """
    coefficients, stiffness, scratch = smoothness
    frames = paths.shape[1]
    for k in range(paths.shape[0]):
        # The inverse of the band is undefined where there is no later frame; the coefficient is 0 there.
        for m in range(REACH + 1):
            for f in range(frames + REACH - m):
                scratch[m, f] = traces[k, m, f] if f < frames - m else 0.0
        _deviate(coefficients, paths[k], stiffness.shape[1], scratch)
        _predict_rows(coefficients, scratch, determined[k])
        for r in range(stiffness.shape[1]):
            w = stiffness[k, r]
            x = scratch[_DIFFERENCES, REACH + r]
            y = scratch[_DIFFERENCES + 1, REACH + r]
            z = scratch[_DIFFERENCES + 2, REACH + r]
            squares[k, r] = w * (x * x + y * y + z * z)
            determined[k, r] = min(max(3.0 - w * determined[k, r], 0.0), 3.0) if w > 0.0 else 0.0
