"""Banded systems that couple each frame with its three neighbors: the paths of keypoints over time.

The matrix of a path is symmetric with 3x3 blocks. Those on the diagonal are arbitrary; frames ``f`` and ``f - m`` are
coupled by a multiple of the identity, because neither smoothness nor contact prefers a direction. The matrix is
factored as ``U D U^T`` with ``U`` unit lower triangular of the same bandwidth.

Frames follow from each other, so several keypoints are processed at once: a tile of ``LANES`` keypoints, whose numbers
have the lane as the last axis. Factors and vectors of a tile begin and end with ``REACH`` frames of zeros.
"""

import numpy as np

from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.jit import disjoint, inline, kernel, subroutine

REACH = 3
"""Number of earlier frames with which a frame is coupled."""

LANES = 8

# Rows of a factor: the 3x3 block of U that couples a frame with the one before, the inverse of the block of D, which is
# symmetric, and the couplings of the matrix with the second and the third frame before. The other blocks of U follow
# from these; reading them would take more time than computing them.
INVERSE = 9
COUPLING_2 = 15
COUPLING_3 = 16
FACTOR_ROWS = 17

_MIN_PIVOT = 1e-13


@inline
def times_transposed(a0, a1, a2, matrix, n):
    """Return the row vector ``a`` times the transposed 3x3 matrix of a lane that starts at ``n``."""
    return (
        a0 * matrix[n] + a1 * matrix[n + LANES] + a2 * matrix[n + 2 * LANES],
        a0 * matrix[n + 3 * LANES] + a1 * matrix[n + 4 * LANES] + a2 * matrix[n + 5 * LANES],
        a0 * matrix[n + 6 * LANES] + a1 * matrix[n + 7 * LANES] + a2 * matrix[n + 8 * LANES],
    )


@inline
def times_matrix(a0, a1, a2, matrix, n):
    """Return the row vector ``a`` times the 3x3 matrix of a lane that starts at ``n``."""
    return (
        a0 * matrix[n] + a1 * matrix[n + 3 * LANES] + a2 * matrix[n + 6 * LANES],
        a0 * matrix[n + LANES] + a1 * matrix[n + 4 * LANES] + a2 * matrix[n + 7 * LANES],
        a0 * matrix[n + 2 * LANES] + a1 * matrix[n + 5 * LANES] + a2 * matrix[n + 8 * LANES],
    )


@inline
def times_symmetric(a0, a1, a2, matrix, n):
    """Return the vector ``a`` times the symmetric matrix of a lane that starts at ``n``."""
    xy = matrix[n + LANES]
    xz = matrix[n + 2 * LANES]
    yz = matrix[n + 4 * LANES]
    return (
        a0 * matrix[n] + a1 * xy + a2 * xz,
        a0 * xy + a1 * matrix[n + 3 * LANES] + a2 * yz,
        a0 * xz + a1 * yz + a2 * matrix[n + 5 * LANES],
    )


@inline
def _column(factor, matrix, n):
    """Return a multiple of the column of a 3x3 matrix of a lane that starts at ``n``."""
    return factor * matrix[n], factor * matrix[n + 3 * LANES], factor * matrix[n + 6 * LANES]


@inline
def _dot(a0, a1, a2, b0, b1, b2):
    """Return the inner product of two vectors."""
    return a0 * b0 + a1 * b1 + a2 * b2


@inline
def store(a0, a1, a2, n, out):
    """Write three numbers of a lane from ``n`` on."""
    out[n] = a0
    out[n + LANES] = a1
    out[n + 2 * LANES] = a2


@inline
def _invert(xx, xy, xz, yy, yz, zz, j, out):
    """Write the inverse of a symmetric positive definite matrix to the last rows of a factor.

    Pivots lost to rounding are replaced by a tiny fraction of the trace, so that undetermined directions stay finite.
    """
    min_pivot = _MIN_PIVOT * (xx + yy + zz) + 1e-300
    w0 = 1.0 / max(xx, min_pivot)
    l1 = xy * w0
    l2 = xz * w0
    w1 = 1.0 / max(yy - l1 * xy, min_pivot)
    e = yz - l1 * xz
    l3 = e * w1
    w2 = 1.0 / max(zz - l2 * xz - l3 * e, min_pivot)
    m = l1 * l3 - l2
    store(w0 + l1 * l1 * w1 + m * m * w2, -l1 * w1 - m * l3 * w2, m * w2, INVERSE * LANES + j, out)
    store(w1 + l3 * l3 * w2, -l3 * w2, w2, (INVERSE + 3) * LANES + j, out)


@disjoint
def _factor_frame(own, first, second, third, across_first, across, out):
    """Factor one frame of a tile.

    Args:
        own: shape (9 * LANES,): the diagonal block, and the couplings with the three frames before.
        first: shape (FACTOR_ROWS * LANES,): factor of the frame before.
        second: of the second frame before.
        third: of the third frame before.
        across_first: shape (9 * LANES,): block of U that couples the frame before with the second one before it.
        across: likewise of this frame, written.
        out: written.
    """
    for j in range(LANES):
        c1, c2, c3 = own[6 * LANES + j], own[7 * LANES + j], own[8 * LANES + j]
        # The rows y and x are those of U D, of the blocks that couple the frame with the second and the one before.
        y00, y01, y02 = _column(-c3, second, 0 * LANES + j)
        y10, y11, y12 = _column(-c3, second, 1 * LANES + j)
        y20, y21, y22 = _column(-c3, second, 2 * LANES + j)
        y00, y11, y22 = y00 + c2, y11 + c2, y22 + c2
        p0, p1, p2 = times_transposed(y00, y01, y02, first, 0 * LANES + j)
        q0, q1, q2 = _column(-c3, across_first, 0 * LANES + j)
        x00, x01, x02 = c1 + q0 - p0, q1 - p1, q2 - p2
        p0, p1, p2 = times_transposed(y10, y11, y12, first, 0 * LANES + j)
        q0, q1, q2 = _column(-c3, across_first, 1 * LANES + j)
        x10, x11, x12 = q0 - p0, c1 + q1 - p1, q2 - p2
        p0, p1, p2 = times_transposed(y20, y21, y22, first, 0 * LANES + j)
        q0, q1, q2 = _column(-c3, across_first, 2 * LANES + j)
        x20, x21, x22 = q0 - p0, q1 - p1, c1 + q2 - p2
        a0, a1, a2 = times_symmetric(x00, x01, x02, first, INVERSE * LANES + j)
        xx = own[j] - _dot(x00, x01, x02, a0, a1, a2)
        xy = own[LANES + j] - _dot(x10, x11, x12, a0, a1, a2)
        xz = own[2 * LANES + j] - _dot(x20, x21, x22, a0, a1, a2)
        store(a0, a1, a2, 0 * LANES + j, out)
        a0, a1, a2 = times_symmetric(x10, x11, x12, first, INVERSE * LANES + j)
        yy = own[3 * LANES + j] - _dot(x10, x11, x12, a0, a1, a2)
        yz = own[4 * LANES + j] - _dot(x20, x21, x22, a0, a1, a2)
        store(a0, a1, a2, 3 * LANES + j, out)
        a0, a1, a2 = times_symmetric(x20, x21, x22, first, INVERSE * LANES + j)
        zz = own[5 * LANES + j] - _dot(x20, x21, x22, a0, a1, a2)
        store(a0, a1, a2, 6 * LANES + j, out)
        a0, a1, a2 = times_symmetric(y00, y01, y02, second, INVERSE * LANES + j)
        xx -= _dot(y00, y01, y02, a0, a1, a2)
        xy -= _dot(y10, y11, y12, a0, a1, a2)
        xz -= _dot(y20, y21, y22, a0, a1, a2)
        store(a0, a1, a2, 0 * LANES + j, across)
        a0, a1, a2 = times_symmetric(y10, y11, y12, second, INVERSE * LANES + j)
        yy -= _dot(y10, y11, y12, a0, a1, a2)
        yz -= _dot(y20, y21, y22, a0, a1, a2)
        store(a0, a1, a2, 3 * LANES + j, across)
        a0, a1, a2 = times_symmetric(y20, y21, y22, second, INVERSE * LANES + j)
        zz -= _dot(y20, y21, y22, a0, a1, a2)
        store(a0, a1, a2, 6 * LANES + j, across)
        third_row = INVERSE * LANES + j
        a0, a1, a2 = c3 * third[third_row], c3 * third[third_row + LANES], c3 * third[third_row + 2 * LANES]
        xx, xy, xz = xx - c3 * a0, xy - c3 * a1, xz - c3 * a2
        third_row = (INVERSE + 3) * LANES + j
        a0, a1, a2 = c3 * third[third_row], c3 * third[third_row + LANES], c3 * third[third_row + 2 * LANES]
        _invert(xx, xy, xz, yy - c3 * a0, yz - c3 * a1, zz - c3 * a2, j, out)
        out[COUPLING_2 * LANES + j] = c2
        out[COUPLING_3 * LANES + j] = c3


@disjoint
def _forward_frame(factor, first, second, third, vector, recent):
    """Solve with ``U`` for one frame of a tile.

    Args:
        factor: shape (FACTOR_ROWS * LANES,).
        first: shape (3 * LANES,): solution of the frame before.
        second: shape (6 * LANES,): see ``recent``, of the second frame before.
        third: of the third frame before.
        vector: shape (3 * LANES,), in and out.
        recent: shape (6 * LANES,), written: the solution divided by the block of D, and the product of the transposed
            block of U and that.
    """
    for j in range(LANES):
        c2 = factor[COUPLING_2 * LANES + j]
        c3 = factor[COUPLING_3 * LANES + j]
        a0, a1, a2 = times_transposed(first[j], first[LANES + j], first[2 * LANES + j], factor, 0 * LANES + j)
        x = vector[j] - a0 - (c2 * second[j] - c3 * second[3 * LANES + j]) - c3 * third[j]
        y = vector[LANES + j] - a1 - (c2 * second[LANES + j] - c3 * second[4 * LANES + j]) - c3 * third[LANES + j]
        z = vector[2 * LANES + j] - a2
        z = z - (c2 * second[2 * LANES + j] - c3 * second[5 * LANES + j]) - c3 * third[2 * LANES + j]
        store(x, y, z, j, vector)
        a0, a1, a2 = times_symmetric(x, y, z, factor, INVERSE * LANES + j)
        store(a0, a1, a2, j, recent)
        x, y, z = times_matrix(a0, a1, a2, factor, 0 * LANES + j)
        store(x, y, z, 3 * LANES + j, recent)


@disjoint
def _backward_frame(factors, first, second, third, vector):
    """Solve with ``D U^T`` for one frame of a tile, given the solutions of the three frames after.

    Args:
        factors: shape (REACH + 1, FACTOR_ROWS * LANES): of the frame and of the three after.
        first: shape (3 * LANES,): solution of the frame after.
        second: of the second frame after.
        third: of the third frame after.
        vector: in and out.
    """
    own = factors[0]
    factor_1 = factors[1]
    factor_2 = factors[2]
    factor_3 = factors[3]
    for j in range(LANES):
        x = second[j]
        y = second[LANES + j]
        z = second[2 * LANES + j]
        c2 = factor_2[COUPLING_2 * LANES + j]
        c3 = factor_2[COUPLING_3 * LANES + j]
        a0, a1, a2 = times_transposed(x, y, z, own, 0 * LANES + j)
        c = factor_3[COUPLING_3 * LANES + j]
        x = vector[j] - (c2 * x - c3 * a0) - c * third[j]
        y = vector[LANES + j] - (c2 * y - c3 * a1) - c * third[LANES + j]
        z = vector[2 * LANES + j] - (c2 * z - c3 * a2) - c * third[2 * LANES + j]
        d0, d1, d2 = times_symmetric(x, y, z, own, INVERSE * LANES + j)
        a0, a1, a2 = times_matrix(first[j], first[LANES + j], first[2 * LANES + j], factor_1, 0 * LANES + j)
        store(d0 - a0, d1 - a1, d2 - a2, j, vector)


@subroutine
def solve_tile(factor, vector, recent):
    """Solve ``U D U^T x = vector`` of one tile in place.

    Args:
        factor: shape (REACH + frame + REACH, FACTOR_ROWS * LANES).
        vector: shape (REACH + frame + REACH, 3 * LANES), in and out.
        recent: shape (4, 6 * LANES), overwritten.
    """
    end = vector.shape[0] - REACH
    for n in range(recent.shape[0]):
        for i in range(6 * LANES):
            recent[n, i] = 0.0
    for f in range(REACH, end):
        second = recent[(f - 2) % 4]
        _forward_frame(factor[f], vector[f - 1], second, recent[(f - 3) % 4], vector[f], recent[f % 4])
    for f in range(end - 1, REACH - 1, -1):
        _backward_frame(factor[f : f + REACH + 1], vector[f + 1], vector[f + 2], vector[f + 3], vector[f])


@inline
def gather_vector(vectors, keypoints, frames, vector):
    """Copy the vectors of the keypoints of a tile, shape (keypoint, block, 3 * BLOCK), to it; other lanes are 0.

    Block after block, because the lanes of one fit in the cache.
    """
    for b in range(vectors.shape[1]):
        first = b * BLOCK
        end = min(BLOCK, frames - first)
        for j in range(LANES):
            own = vectors[max(keypoints[j], 0), b]
            for i in range(3):
                for n in range(end):
                    vector[REACH + first + n, i * LANES + j] = own[i * BLOCK + n] if keypoints[j] >= 0 else 0.0


@inline
def scatter_vector(vector, keypoints, frames, vectors):
    """Copy a tile to the vectors of its keypoints, shape (keypoint, block, 3 * BLOCK)."""
    for b in range(vectors.shape[1]):
        first = b * BLOCK
        end = min(BLOCK, frames - first)
        for j in range(LANES):
            if keypoints[j] >= 0:
                own = vectors[keypoints[j], b]
                for i in range(3):
                    for n in range(end):
                        own[i * BLOCK + n] = vector[REACH + first + n, i * LANES + j]


@inline
def _gather_matrix(diagonal, coupling, keypoints, f, own):
    """Copy the matrix of a frame of the keypoints of a tile; the other lanes stay unchanged."""
    for j in range(LANES):
        k = keypoints[j]
        if k >= 0:
            for i in range(6):
                own[i * LANES + j] = diagonal[k, f // BLOCK, i * BLOCK + f % BLOCK]
            for m in range(REACH):
                own[(6 + m) * LANES + j] = coupling[k, f // BLOCK, m * BLOCK + f % BLOCK]


@kernel
def factor_paths(diagonal, coupling, tiles, factor):
    """Factor the matrices of all paths.

    Args:
        diagonal: shape (keypoint, block, 6 * BLOCK): see :mod:`posefuse.kernels.trajectory.blocks`.
        coupling: shape (keypoint, block, REACH * BLOCK): of each frame with the three before, 0 where there is none.
        tiles: shape (tile, LANES), int64: keypoints; -1 where a lane is not used.
        factor: shape (tile, REACH + frame + REACH, FACTOR_ROWS * LANES), written.
    """
    own = np.empty(9 * LANES)
    across = np.empty((2, 9 * LANES))
    end = factor.shape[1] - REACH
    for t in range(tiles.shape[0]):
        for j in range(LANES):
            for i in range(9):
                own[i * LANES + j] = 1.0 if i == 0 or i == 3 or i == 5 else 0.0
                across[(REACH - 1) % 2, i * LANES + j] = 0.0
        for f in range(REACH):
            for i in range(FACTOR_ROWS * LANES):
                factor[t, f, i] = 0.0
                factor[t, end + f, i] = 0.0
        for f in range(REACH, end):
            _gather_matrix(diagonal, coupling, tiles[t], f - REACH, own)
            first, second, third = factor[t, f - 1], factor[t, f - 2], factor[t, f - 3]
            _factor_frame(own, first, second, third, across[(f - 1) % 2], across[f % 2], factor[t, f])
