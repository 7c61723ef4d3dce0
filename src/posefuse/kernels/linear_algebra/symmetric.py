"""Small symmetric systems: Cholesky factors, and inverses in place."""

import math

from posefuse.kernels.jit import dense


@dense
def factor(matrix, n):
    """Cholesky factor of the first ``n`` rows and columns, into their lower triangle; whether they are positive."""
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if j < i:
                matrix[i, j] = total / matrix[j, j]
            elif total > 0.0:
                matrix[i, i] = math.sqrt(total)
            else:
                return False
    return True


@dense
def solve_factored(lower, n, vector):
    """Solve ``L L^T x = vector`` in place."""
    for i in range(n):
        total = vector[i]
        for k in range(i):
            total -= lower[i, k] * vector[k]
        vector[i] = total / lower[i, i]
    for i in range(n - 1, -1, -1):
        vector[i] /= lower[i, i]
        for k in range(i):
            vector[k] -= lower[i, k] * vector[i]


@dense
def invert(matrix, n, row):
    """The inverse of the first ``n`` rows and columns, from their lower triangle, whole, in place; whether positive.

    By sweeping every pivot (J. H. Goodnight, "A tutorial on the SWEEP operator", The American Statistician 33, 1979).
    It does as much work as a Cholesky factor and its inverse, but along rows, which vector instructions like: a third
    of the time.

    Args:
        matrix: shape (at least n, at least n), in and out; half done where not positive.
        n: how many rows and columns.
        row: shape (at least n,), room.
    """
    for k in range(n):
        pivot = matrix[k, k]
        if not pivot > 0.0:
            return False
        scale = 1.0 / pivot
        for j in range(k):
            row[j] = matrix[k, j]
        for i in range(k + 1, n):
            row[i] = matrix[i, k]
        for i in range(n):
            if i == k:
                continue
            by = row[i] * scale
            for j in range(i + 1):
                matrix[i, j] -= by * row[j]
        for j in range(k):
            matrix[k, j] = row[j] * scale
        for i in range(k + 1, n):
            matrix[i, k] = row[i] * scale
        matrix[k, k] = -scale
    for i in range(n):
        for j in range(i + 1):
            matrix[i, j] = -matrix[i, j]
            matrix[j, i] = matrix[i, j]
    return True


@dense
def multiply(left, first, right, rows, m, out):
    """``out = left[first:] right``, of ``rows`` rows and ``m`` columns.

    Four terms at a time, so that a row is read and written a quarter as often: half of the time.
    """
    for i in range(rows):
        row = first + i
        for j in range(m):
            out[i, j] = 0.0
        for k in range(0, m - 3, 4):
            a, b, c, d = left[row, k], left[row, k + 1], left[row, k + 2], left[row, k + 3]
            for j in range(m):
                out[i, j] += a * right[k, j] + b * right[k + 1, j] + c * right[k + 2, j] + d * right[k + 3, j]
        for k in range(m - m % 4, m):
            by = left[row, k]
            for j in range(m):
                out[i, j] += by * right[k, j]


@dense
def subtract_products(matrix, first, right, n, m):
    """``matrix[first:, first:] -= matrix[first:, :m] right^T``, which is symmetric, of ``n`` rows; four at a time."""
    for i in range(n):
        row = first + i
        for j in range(0, i - 2, 4):
            a = b = c = d = 0.0
            for k in range(m):
                by = matrix[row, k]
                a += by * right[j, k]
                b += by * right[j + 1, k]
                c += by * right[j + 2, k]
                d += by * right[j + 3, k]
            matrix[row, first + j] -= a
            matrix[row, first + j + 1] -= b
            matrix[row, first + j + 2] -= c
            matrix[row, first + j + 3] -= d
        for j in range((i + 1) - (i + 1) % 4, i + 1):
            total = 0.0
            for k in range(m):
                total += matrix[row, k] * right[j, k]
            matrix[row, first + j] -= total
        for j in range(i):
            matrix[first + j, row] = matrix[row, first + j]
