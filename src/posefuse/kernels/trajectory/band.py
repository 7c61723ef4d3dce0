"""Banded systems that couple each frame with its three neighbors: the paths of keypoints over time.

The matrix of a path is symmetric with 3x3 blocks: ``band[f, m]`` couples frames ``f`` and ``f - m``. It is factored as
``U D U^T`` with ``U`` unit lower triangular of the same bandwidth. The blocks of the inverse within the band follow
from the factor alone, last frame first (K. Takahashi et al. 1973; Erisman & Tinney, "On computing certain elements of
the inverse of a sparse matrix", Communications of the ACM 18, 1975).
"""

import math

import numpy as np

from posefuse.kernels.jit import inline, kernel, vectorized

REACH = 3
"""Number of earlier frames with which a frame is coupled."""

_MIN_PIVOT = 1e-13


@inline
def subtract_product(left, right, out):
    """Compute ``out -= left right^T``, 3x3 each."""
    for i in range(3):
        for j in range(3):
            out[i, j] -= left[i, 0] * right[j, 0] + left[i, 1] * right[j, 1] + left[i, 2] * right[j, 2]


@vectorized
def invert_3(matrix, out):
    """Invert a symmetric positive definite 3x3 matrix; return the logarithm of its determinant.

    Pivots lost to rounding are replaced by a tiny fraction of the trace, so that undetermined directions stay finite.
    """
    min_pivot = _MIN_PIVOT * (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) + 1e-300
    d0 = max(matrix[0, 0], min_pivot)
    l1 = matrix[1, 0] / d0
    l2 = matrix[2, 0] / d0
    d1 = max(matrix[1, 1] - l1 * matrix[1, 0], min_pivot)
    e = matrix[2, 1] - l1 * matrix[2, 0]
    l3 = e / d1
    d2 = max(matrix[2, 2] - l2 * matrix[2, 0] - l3 * e, min_pivot)
    w0 = 1.0 / d0
    w1 = 1.0 / d1
    w2 = 1.0 / d2
    m = l1 * l3 - l2
    out[0, 0] = w0 + l1 * l1 * w1 + m * m * w2
    out[0, 1] = out[1, 0] = -l1 * w1 - m * l3 * w2
    out[0, 2] = out[2, 0] = m * w2
    out[1, 1] = w1 + l3 * l3 * w2
    out[1, 2] = out[2, 1] = -l3 * w2
    out[2, 2] = w2
    return math.log(d0) + math.log(d1) + math.log(d2)


@vectorized
def factor_path(band, lower, inverse, scratch):
    """Factor the matrix of one path; return the logarithm of its determinant.

    Args:
        band: shape (frame, REACH + 1, 3, 3).
        lower: shape (frame, REACH, 3, 3), written: ``U``, the block of frames ``f`` and ``f - m`` at ``[f, m - 1]``.
        inverse: shape (frame, 3, 3), written: inverses of the blocks of ``D``.
        scratch: shape (REACH + 2, 3, 3).
    """
    total = 0.0
    for f in range(band.shape[0]):
        n_earlier = min(REACH, f)
        for m in range(n_earlier, 0, -1):
            x = scratch[m]
            for i in range(3):
                for j in range(3):
                    x[i, j] = band[f, m, i, j]
            for n in range(m + 1, n_earlier + 1):
                subtract_product(scratch[n], lower[f - m, n - m - 1], x)
        pivot = scratch[0]
        for i in range(3):
            for j in range(3):
                pivot[i, j] = band[f, 0, i, j]
        for m in range(1, n_earlier + 1):
            u = lower[f, m - 1]
            x = scratch[m]
            d = inverse[f - m]
            for i in range(3):
                for j in range(3):
                    u[i, j] = x[i, 0] * d[0, j] + x[i, 1] * d[1, j] + x[i, 2] * d[2, j]
            subtract_product(x, u, pivot)
        total += invert_3(pivot, inverse[f])
    return total


@vectorized
def solve_path(lower, inverse, vector):
    """Solve ``U D U^T x = vector``, shape (frame, 3), in place."""
    frames = vector.shape[0]
    for f in range(frames):
        for m in range(1, min(REACH, f) + 1):
            u = lower[f, m - 1]
            y = vector[f - m]
            for i in range(3):
                vector[f, i] -= u[i, 0] * y[0] + u[i, 1] * y[1] + u[i, 2] * y[2]
    for f in range(frames - 1, -1, -1):
        x = vector[f, 0]
        y = vector[f, 1]
        z = vector[f, 2]
        d = inverse[f]
        for i in range(3):
            vector[f, i] = d[i, 0] * x + d[i, 1] * y + d[i, 2] * z
        for m in range(1, min(REACH, frames - 1 - f) + 1):
            u = lower[f + m, m - 1]
            y = vector[f + m]
            for i in range(3):
                vector[f, i] -= u[0, i] * y[0] + u[1, i] * y[1] + u[2, i] * y[2]


@inline
def _subtract_matrix_product(left, right, out):
    """Compute ``out -= left right``, 3x3 each."""
    for i in range(3):
        for j in range(3):
            out[i, j] -= left[i, 0] * right[0, j] + left[i, 1] * right[1, j] + left[i, 2] * right[2, j]


@inline
def _subtract_transposed_product(left, right, out):
    """Compute ``out -= left^T right``, 3x3 each."""
    for i in range(3):
        for j in range(3):
            out[i, j] -= left[0, i] * right[0, j] + left[1, i] * right[1, j] + left[2, i] * right[2, j]


@vectorized
def _fill_later_blocks(lower, covariance, f, n_later):
    """Write the blocks of the inverse that couple frame ``f`` with later frames."""
    for m in range(1, n_later + 1):
        z = covariance[f + m, m]
        for i in range(3):
            for j in range(3):
                z[i, j] = 0.0
        for n in range(1, n_later + 1):
            # The block of frames f + m and f + n is stored with the later one.
            if m >= n:
                _subtract_matrix_product(covariance[f + m, m - n], lower[f + n, n - 1], z)
            else:
                _subtract_transposed_product(covariance[f + n, n - m], lower[f + n, n - 1], z)


@vectorized
def invert_path(lower, inverse, covariance):
    """Compute the inverse within the band, in the layout of the band.

    Args:
        lower: from :func:`factor_path`.
        inverse: from :func:`factor_path`.
        covariance: shape (frame, REACH + 1, 3, 3), written: the block of frames ``f`` and ``f - m`` at ``[f, m]``.
    """
    frames = covariance.shape[0]
    for f in range(frames - 1, -1, -1):
        n_later = min(REACH, frames - 1 - f)
        _fill_later_blocks(lower, covariance, f, n_later)
        own = covariance[f, 0]
        for i in range(3):
            for j in range(3):
                own[i, j] = inverse[f, i, j]
        for m in range(1, n_later + 1):
            _subtract_transposed_product(covariance[f + m, m], lower[f + m, m - 1], own)
        # Symmetrize: asymmetry from rounding would grow from frame to frame.
        for i in range(3):
            for j in range(i):
                own[i, j] = own[j, i] = 0.5 * (own[i, j] + own[j, i])


@kernel
def factor_paths(band, lower, inverse, log_determinants):
    """Factor the matrices of all paths; the first axis is the keypoint, the others follow :func:`factor_path`."""
    scratch = np.empty((REACH + 2, 3, 3))
    for k in range(band.shape[0]):
        log_determinants[k] = factor_path(band[k], lower[k], inverse[k], scratch)


@kernel
def solve_paths(lower, inverse, vectors):
    """Solve every path separately, vectors of shape (keypoint, frame, 3), in place."""
    for k in range(vectors.shape[0]):
        solve_path(lower[k], inverse[k], vectors[k])


@kernel
def invert_paths(lower, inverse, covariance):
    """Write the inverse within the band of every path, shape (keypoint, frame, REACH + 1, 3, 3)."""
    for k in range(covariance.shape[0]):
        invert_path(lower[k], inverse[k], covariance[k])
