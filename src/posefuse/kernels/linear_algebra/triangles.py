"""Covariances of states as their lower triangles, without the shape's rows where that is kept."""

from posefuse.kernels.jit import inline, kernel


@inline
def _row(i, n_pose, kept):
    """Which row of a covariance the ``i``-th is that is kept in a triangle."""
    return i + kept if i >= n_pose else i


@kernel
def pack_triangle(covariance, n_pose, kept, out):
    """One covariance.

    Args:
        covariance: shape (all, all).
        n_pose: how many rows of it are the pose's.
        kept: how many after them are the shape's and left out.
        out: shape (number,), written: row by row.
    """
    place = 0
    for i in range(covariance.shape[0] - kept):
        row = _row(i, n_pose, kept)
        for j in range(i + 1):
            out[place] = covariance[row, _row(j, n_pose, kept)]
            place += 1


@kernel
def unpack_triangles(packed, free, n_pose, n_shape, covariance):
    """Many, one after the other; what was left out is 0.

    Args:
        packed: shape (number,): of all.
        free: shape (frame,), int64: 0 where the shape's rows were left out.
        n_pose: how many rows are the pose's.
        n_shape: how many after them are the shape's.
        covariance: shape (frame, all, all), written.
    """
    place = 0
    for k in range(free.shape[0]):
        kept = 0 if free[k] != 0 else n_shape
        if kept > 0:
            for i in range(covariance.shape[1]):
                for j in range(n_pose, n_pose + n_shape):
                    covariance[k, i, j] = 0.0
                    covariance[k, j, i] = 0.0
        for i in range(covariance.shape[1] - kept):
            row = _row(i, n_pose, kept)
            for j in range(i + 1):
                column = _row(j, n_pose, kept)
                covariance[k, row, column] = packed[place]
                covariance[k, column, row] = packed[place]
                place += 1
