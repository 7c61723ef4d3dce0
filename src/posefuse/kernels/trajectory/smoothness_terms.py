"""The prior that finite differences over neighboring frames are small, in the trajectory system.

Arrays of numbers per keypoint and frame are in blocks, see :mod:`posefuse.kernels.trajectory.blocks`.
"""

from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.jit import disjoint, inline, kernel
from posefuse.kernels.trajectory.band import REACH


class SmoothnessTerms(NamedTuple):
    """Smoothness prior of all paths.

    Attributes:
        differences: shape (row, REACH + 1): coefficients of frames ``row`` to ``row + REACH``; the last may be 0 with
            the frame missing.
        stiffness: shape (keypoint, row): inverse of the expected variance of the result of a row.
        ridge: shape (keypoint,): small information that ties each point to its current position.
    """

    differences: Any
    stiffness: Any
    ridge: Any


@inline
def _transpose(differences, coefficients):
    """Copy the coefficients of the rows, shape (row, REACH + 1), to (REACH + 1, REACH + row)."""
    for r in range(differences.shape[0]):
        for a in range(REACH + 1):
            coefficients[a, REACH + r] = differences[r, a]


@inline
def _split(path, coordinates):
    """Copy a path, shape (frame, 3), to the rows of its coordinates."""
    for f in range(path.shape[0]):
        for i in range(3):
            coordinates[i, f] = path[f, i]


@disjoint
def _deviate(coefficients, path, n_rows, deviation):
    """Write the finite differences of a path, shape (3, REACH + frame), to ``deviation``."""
    for i in range(3):
        for r in range(n_rows):
            n = REACH + r
            deviation[i, n] = (
                coefficients[0, n] * path[i, r]
                + coefficients[1, n] * path[i, r + 1]
                + coefficients[2, n] * path[i, r + 2]
                + coefficients[3, n] * path[i, r + 3]
            )


@disjoint
def _sum_rows(coefficients, weighted, deviation, first, out):
    """Sum the rows that contain each frame of a block: own matrix, coupling with the three frames before, gradient."""
    for j in range(BLOCK):
        n = REACH + first + j
        w0 = weighted[0, n]
        w1 = weighted[1, n - 1]
        w2 = weighted[2, n - 2]
        w3 = weighted[3, n - 3]
        out[j] = w0 * coefficients[0, n] + w1 * coefficients[1, n - 1]
        out[j] += w2 * coefficients[2, n - 2] + w3 * coefficients[3, n - 3]
        out[BLOCK + j] = w1 * coefficients[0, n - 1] + w2 * coefficients[1, n - 2] + w3 * coefficients[2, n - 3]
        out[2 * BLOCK + j] = w2 * coefficients[0, n - 2] + w3 * coefficients[1, n - 3]
        out[3 * BLOCK + j] = w3 * coefficients[0, n - 3]
        for i in range(3):
            gradient = w0 * deviation[i, n] + w1 * deviation[i, n - 1] + w2 * deviation[i, n - 2]
            out[(4 + i) * BLOCK + j] = gradient + w3 * deviation[i, n - 3]


@kernel
def add_smoothness(smoothness, paths, system):
    """Write the matrix of views and smoothness, and add the gradient of smoothness.

    Args:
        smoothness: SmoothnessTerms.
        paths: shape (keypoint, frame, 3).
        system: PathSystem; the diagonal and the coupling are written, and the right-hand side is added to.
    """
    differences, stiffness, ridge = smoothness
    diagonal, coupling, rhs, information = system
    n_rows = differences.shape[0]
    length = REACH + BLOCK * diagonal.shape[1]
    # Row ``r`` of the prior is at ``REACH + r``: before the first and after the last there is none.
    coefficients = np.zeros((REACH + 1, length))
    weighted = np.zeros((REACH + 1, length))
    deviation = np.zeros((3, length))
    path = np.zeros((3, length))
    sums = np.empty(7 * BLOCK)
    _transpose(differences, coefficients)
    for k in range(paths.shape[0]):
        _split(paths[k], path)
        _deviate(coefficients, path, n_rows, deviation)
        for a in range(REACH + 1):
            for r in range(n_rows):
                weighted[a, REACH + r] = stiffness[k, r] * coefficients[a, REACH + r]
        for b in range(diagonal.shape[1]):
            _sum_rows(coefficients, weighted, deviation, b * BLOCK, sums)
            for i in range(6):
                for j in range(BLOCK):
                    own = sums[j] + ridge[k] if i in (0, 3, 5) else 0.0
                    diagonal[k, b, i * BLOCK + j] = information[k, b, i * BLOCK + j] + own
            for i in range(3):
                for j in range(BLOCK):
                    coupling[k, b, i * BLOCK + j] = sums[(1 + i) * BLOCK + j]
                    rhs[k, b, i * BLOCK + j] -= sums[(4 + i) * BLOCK + j]


@disjoint
def _predict_rows(coefficients, traces, n_rows, out):
    """Write the variance of each finite difference of one path, summed over its three components.

    Args:
        coefficients: shape (REACH + 1, row).
        traces: shape (REACH + 1, REACH + frame): of the blocks of the covariance that couple each frame with itself
            and with the next three.
        n_rows: number of rows.
        out: shape (row,), written.
    """
    for r in range(n_rows):
        c0 = coefficients[0, r]
        c1 = coefficients[1, r]
        c2 = coefficients[2, r]
        c3 = coefficients[3, r]
        total = c0 * c0 * traces[0, r] + c1 * c1 * traces[0, r + 1]
        total += c2 * c2 * traces[0, r + 2] + c3 * c3 * traces[0, r + 3]
        total += 2.0 * (c0 * c1 * traces[1, r] + c1 * c2 * traces[1, r + 1] + c2 * c3 * traces[1, r + 2])
        out[r] = total + 2.0 * (c0 * c2 * traces[2, r] + c1 * c3 * traces[2, r + 1] + c0 * c3 * traces[3, r])


@kernel
def squared_differences(differences, stiffness, paths, traces, squares, determined):
    """Compute squared finite differences of the paths, and how many of their components the data determine.

    Args:
        differences: shape (row, REACH + 1).
        stiffness: shape (keypoint, row): inverse of the expected variance of a row.
        paths: shape (keypoint, frame, 3).
        traces: shape (keypoint, REACH + 1, frame), from :func:`posefuse.kernels.trajectory.band_inverse.invert_paths`.
        squares: shape (keypoint, row), written: squared difference in units of the expected variance.
        determined: shape (keypoint, row), written: number of the 3 components that the data determine.
    """
    n_rows = differences.shape[0]
    frames = paths.shape[1]
    coefficients = np.zeros((REACH + 1, REACH + n_rows))
    path = np.zeros((3, REACH + frames))
    own = np.zeros((REACH + 1, REACH + frames))
    deviation = np.zeros((3, REACH + n_rows))
    variance = np.empty(n_rows)
    _transpose(differences, coefficients)
    for k in range(paths.shape[0]):
        _split(paths[k], path)
        # The inverse of the band is undefined where there is no later frame.
        for m in range(REACH + 1):
            for f in range(frames - m):
                own[m, f] = traces[k, m, f]
        _deviate(coefficients, path, n_rows, deviation)
        _predict_rows(coefficients[:, REACH:], own, n_rows, variance)
        for r in range(n_rows):
            w = stiffness[k, r]
            n = REACH + r
            squared = deviation[0, n] * deviation[0, n] + deviation[1, n] * deviation[1, n]
            squares[k, r] = w * (squared + deviation[2, n] * deviation[2, n])
            determined[k, r] = min(max(3.0 - w * variance[r], 0.0), 3.0) if w > 0.0 else 0.0
