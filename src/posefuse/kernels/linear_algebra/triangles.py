"""Packed lower triangles of state covariances, without the rows of the shape where it is fixed."""

from posefuse.kernels.jit import inline, kernel, subroutine


@inline
def _row_index(i, n_pose, n_fixed):
    """Return the row of the covariance that is row ``i`` of the packed triangle."""
    return i + n_fixed if i >= n_pose else i


@subroutine
def pack_triangle(covariance, n_pose, n_fixed, out):
    """Pack one covariance.

    Args:
        covariance: shape (all, all).
        n_pose: number of rows of the pose.
        n_fixed: number of rows of a fixed shape after them, which are omitted.
        out: shape (number,) or longer, written: row by row.
    """
    position = 0
    for i in range(covariance.shape[0] - n_fixed):
        row = _row_index(i, n_pose, n_fixed)
        for j in range(i + 1):
            out[position] = covariance[row, _row_index(j, n_pose, n_fixed)]
            position += 1


@kernel
def unpack_triangles(packed, shape_free, n_pose, n_shape, covariance):
    """Unpack consecutive packed covariances; omitted entries become 0.

    Args:
        packed: shape (number,): all triangles.
        shape_free: shape (frame,), int64: 0 where the rows of the shape were omitted.
        n_pose: number of rows of the pose.
        n_shape: number of rows of the shape after them.
        covariance: shape (frame, all, all), written.
    """
    position = 0
    for k in range(shape_free.shape[0]):
        n_fixed = 0 if shape_free[k] != 0 else n_shape
        if n_fixed > 0:
            for i in range(covariance.shape[1]):
                for j in range(n_pose, n_pose + n_shape):
                    covariance[k, i, j] = 0.0
                    covariance[k, j, i] = 0.0
        for i in range(covariance.shape[1] - n_fixed):
            row = _row_index(i, n_pose, n_fixed)
            for j in range(i + 1):
                column = _row_index(j, n_pose, n_fixed)
                covariance[k, row, column] = packed[position]
                covariance[k, column, row] = packed[position]
                position += 1
