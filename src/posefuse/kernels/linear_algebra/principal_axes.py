"""Principal axes of symmetric 3x3 matrices."""

import math

from posefuse.kernels.jit import subroutine

_MAX_SWEEPS = 12
"""Jacobi rotations converge quadratically: five sweeps reach the rounding errors of any matrix."""

_NEGLIGIBLE = 1e-17
"""Common entry, relative to the smaller diagonal entry, below which a rotation changes nothing."""


@subroutine
def diagonalize(matrix, axes):
    """Diagonalize a symmetric 3x3 matrix in place by Jacobi rotations.

    Args:
        matrix: shape (3, 3); on return its diagonal contains the eigenvalues, in no particular order.
        axes: shape (3, 3), set to the eigenvectors, one per column.
    """
    for i in range(3):
        for j in range(3):
            axes[i, j] = 1.0 if i == j else 0.0
    for _ in range(_MAX_SWEEPS):
        if matrix[0, 1] == 0.0 and matrix[0, 2] == 0.0 and matrix[1, 2] == 0.0:
            return
        for p in range(2):
            for q in range(p + 1, 3):
                _rotate(matrix, axes, p, q)


@subroutine
def _rotate(matrix, axes, p, q):
    """Rotate rows and columns p and q such that their common entry vanishes."""
    common = matrix[p, q]
    if common == 0.0:
        return
    half = 0.5 * (matrix[q, q] - matrix[p, p])
    tangent = common / (half + math.copysign(math.hypot(half, common), half))
    cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
    sine = tangent * cosine
    shift = tangent * common
    matrix[p, p] -= shift
    matrix[q, q] += shift
    matrix[p, q] = 0.0
    matrix[q, p] = 0.0
    if abs(common) < _NEGLIGIBLE * min(abs(matrix[p, p]), abs(matrix[q, q])):
        return
    r = 3 - p - q
    one, other = matrix[r, p], matrix[r, q]
    matrix[r, p] = cosine * one - sine * other
    matrix[r, q] = sine * one + cosine * other
    matrix[p, r] = matrix[r, p]
    matrix[q, r] = matrix[r, q]
    for i in range(3):
        one, other = axes[i, p], axes[i, q]
        axes[i, p] = cosine * one - sine * other
        axes[i, q] = sine * one + cosine * other
