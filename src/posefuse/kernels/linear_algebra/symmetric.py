"""Symmetric systems: Cholesky factorization, solution, and inversion in place."""

import math

from posefuse.kernels.jit import vectorized


@vectorized
def cholesky(matrix, n):
    """Write the Cholesky factor of the first ``n`` rows to the lower triangle; return True if positive definite."""
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


@vectorized
def cholesky_solve(lower, n, vector):
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


@vectorized
def invert(matrix, n, scratch):
    """Invert the first ``n`` rows and columns in place, from their lower triangle; return True if positive definite.

    The method sweeps every pivot (J. H. Goodnight, "A tutorial on the SWEEP operator", The American Statistician 33,
    1979).
    It needs as many operations as a Cholesky factor and its inverse, but along rows, which suits vector instructions: a
    third of the time. Two pivots are swept at a time, so that the matrix is read and written half as often.

    Args:
        matrix: shape (at least n, at least n), in and out; undefined if not positive definite.
        n: number of rows and columns.
        scratch: shape (at least 2 n,).
    """
    one = scratch[:n]
    two = scratch[n : 2 * n]
    for k in range(0, n - 1, 2):
        if not _sweep_two(matrix, n, k, one, two):
            return False
    if n % 2 == 1 and not _sweep_last(matrix, n, one):
        return False
    for i in range(n):
        for j in range(i + 1):
            matrix[i, j] = -matrix[i, j]
            matrix[j, i] = matrix[i, j]
    return True


@vectorized
def _sweep_two(matrix, n, k, one, two):
    """Sweep the pivots ``k`` and ``k + 1``; return whether they are positive."""
    m = k + 1
    for j in range(k):
        one[j] = matrix[k, j]
        two[j] = matrix[m, j]
    for i in range(m + 1, n):
        one[i] = matrix[i, k]
        two[i] = matrix[i, m]
    one[k] = one[m] = two[k] = two[m] = 0.0
    if not matrix[k, k] > 0.0:
        return False
    first = 1.0 / matrix[k, k]
    link = matrix[m, k] * first
    pivot = matrix[m, m] - link * matrix[m, k]
    if not pivot > 0.0:
        return False
    second = 1.0 / pivot
    for j in range(n):
        two[j] -= link * one[j]
    for i in range(n):
        if k <= i <= m:
            continue
        a = one[i] * first
        b = two[i] * second
        for j in range(i + 1):
            matrix[i, j] -= a * one[j] + b * two[j]
    link_second = link * second
    for j in range(k):
        matrix[k, j] = one[j] * first - two[j] * link_second
        matrix[m, j] = two[j] * second
    for i in range(m + 1, n):
        matrix[i, k] = one[i] * first - two[i] * link_second
        matrix[i, m] = two[i] * second
    matrix[k, k] = -first - link * link_second
    matrix[m, k] = link_second
    matrix[m, m] = -second
    return True


@vectorized
def _sweep_last(matrix, n, row):
    """Sweep the last pivot; return whether it is positive."""
    k = n - 1
    if not matrix[k, k] > 0.0:
        return False
    scale = 1.0 / matrix[k, k]
    for j in range(k):
        row[j] = matrix[k, j]
    for i in range(k):
        multiplier = row[i] * scale
        for j in range(i + 1):
            matrix[i, j] -= multiplier * row[j]
    for j in range(k):
        matrix[k, j] = row[j] * scale
    matrix[k, k] = -scale
    return True


@vectorized
def multiply(left, first, right, rows, m, out):
    """Compute ``out = left[first:] right`` with ``rows`` rows and ``m`` columns.

    Four terms are added at a time, so that each output row is read and written a quarter as often: half of the time.
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
            multiplier = left[row, k]
            for j in range(m):
                out[i, j] += multiplier * right[k, j]


@vectorized
def subtract_symmetric_product(matrix, first, right, n, m):
    """Compute ``matrix[first:, first:] -= matrix[first:, :m] right^T``, a symmetric product of ``n`` rows."""
    for i in range(n):
        row = first + i
        for j in range(0, i - 2, 4):
            a = b = c = d = 0.0
            for k in range(m):
                multiplier = matrix[row, k]
                a += multiplier * right[j, k]
                b += multiplier * right[j + 1, k]
                c += multiplier * right[j + 2, k]
                d += multiplier * right[j + 3, k]
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
