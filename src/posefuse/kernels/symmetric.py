"""Small symmetric systems: Cholesky factors and inverses, in place."""

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
def invert_factored(lower, n, inverse):
    """``(L L^T)^-1``, whole, into ``inverse``; ``lower`` is used up."""
    # L^-1 in place, a column at a time.
    for j in range(n):
        lower[j, j] = 1.0 / lower[j, j]
        for i in range(j + 1, n):
            lower[j, i] = 0.0
    for j in range(n):
        for i in range(j + 1, n):
            # Row i of L^-1: -(sum over k of L[i, k] X[k, j]) / L[i, i], kept transposed above the diagonal.
            total = lower[i, j] * lower[j, j]
            for k in range(j + 1, i):
                total += lower[i, k] * lower[j, k]
            lower[j, i] = -total * lower[i, i]
    for i in range(n):
        for j in range(i + 1):
            total = lower[i, i] * (lower[j, i] if j < i else lower[i, i])
            for k in range(i + 1, n):
                total += lower[i, k] * lower[j, k]
            inverse[i, j] = total
            inverse[j, i] = total
