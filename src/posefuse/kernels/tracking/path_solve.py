"""Block band systems of consecutive poses: factorization, solution, and the inverse within the band.

Blocks are dense, except that the block of a frame and the second one after it is diagonal. The factorization is
``L D L^T`` with unit blocks on the diagonal of ``L``; the inverse within the band follows from the last frame to the
first (Takahashi, Fagan and Chin, 1973).
"""

from typing import Any, NamedTuple

from posefuse.kernels.jit import kernel, vectorized
from posefuse.kernels.linear_algebra.symmetric import invert, multiply


class PathFactor(NamedTuple):
    """Factor of a block band matrix.

    Attributes:
        inverse: shape (frame, m, m): inverse of each diagonal block of ``D``.
        first: shape (frame, m, m): block of ``L`` in the row of the next frame.
        second: shape (frame, m, m): block of ``L`` in the row of the second frame.
    """

    inverse: Any
    first: Any
    second: Any


@vectorized
def _subtract_product(left, right, m, lower, out):
    """Compute ``out -= left right^T``, or its lower triangle only.

    Four columns are computed at a time, so that each row of ``left`` is read a quarter as often.
    """
    for i in range(m):
        stop = i + 1 if lower else m
        for j in range(0, stop - 3, 4):
            a = b = c = d = 0.0
            for k in range(m):
                multiplier = left[i, k]
                a += multiplier * right[j, k]
                b += multiplier * right[j + 1, k]
                c += multiplier * right[j + 2, k]
                d += multiplier * right[j + 3, k]
            out[i, j] -= a
            out[i, j + 1] -= b
            out[i, j + 2] -= c
            out[i, j + 3] -= d
        for j in range(stop - stop % 4, stop):
            total = 0.0
            for k in range(m):
                total += left[i, k] * right[j, k]
            out[i, j] -= total


@vectorized
def _subtract_scaled_columns(left, factors, m, out):
    """Compute ``out -= left diag(factors)``."""
    for i in range(m):
        for j in range(m):
            out[i, j] -= left[i, j] * factors[j]


@kernel
def factor_path(system, factor, scratch):
    """Factor the matrix of a system, whose blocks are overwritten; return the number of completed frames.

    Args:
        system: PathSystem with pose columns only; diagonal and next are overwritten.
        factor: PathFactor, written.
        scratch: shape (2 * pose,).
    """
    frames, m = system.gradient.shape
    for t in range(frames):
        block = system.diagonal[t]
        if not invert(block, m, scratch):
            return t
        for i in range(m):
            for j in range(m):
                factor.inverse[t, i, j] = block[i, j]
        if t + 1 < frames:
            multiply(system.next[t + 1], 0, block, m, m, factor.first[t])
            _subtract_product(factor.first[t], system.next[t + 1], m, True, system.diagonal[t + 1])
        if t + 2 < frames:
            far = system.second[t + 2]
            for i in range(m):
                for j in range(m):
                    factor.second[t, i, j] = far[i] * block[i, j]
            _subtract_product(factor.second[t], system.next[t + 1], m, False, system.next[t + 2])
            _subtract_scaled_columns(factor.second[t], far, m, system.diagonal[t + 2])
    return frames


@kernel
def solve_path(factor, right, scratch):
    """Solve the system in place.

    Args:
        factor: PathFactor.
        right: shape (frame, pose, number): right-hand sides, replaced by the solutions.
        scratch: shape (pose, number).
    """
    frames, m, count = right.shape
    for t in range(frames):
        if t + 1 < frames:
            _subtract(factor.first[t], right[t], m, right[t + 1])
        if t + 2 < frames:
            _subtract(factor.second[t], right[t], m, right[t + 2])
    for t in range(frames - 1, -1, -1):
        for i in range(m):
            for c in range(count):
                scratch[i, c] = 0.0
        _subtract(factor.inverse[t], right[t], m, scratch)
        for i in range(m):
            for c in range(count):
                right[t, i, c] = -scratch[i, c]
        if t + 1 < frames:
            _subtract_transposed(factor.first[t], right[t + 1], m, False, right[t])
        if t + 2 < frames:
            _subtract_transposed(factor.second[t], right[t + 2], m, False, right[t])


@kernel
def invert_path(factor, inverse, first, second):
    """Write the inverse within the band.

    Args:
        factor: PathFactor.
        inverse: shape (frame, pose, pose), written: blocks of each frame.
        first: shape (frame, pose, pose), written: row block of the next frame, column block of each frame.
        second: shape (frame, pose, pose), written: row block of the second frame, column block of each frame.
    """
    frames, m = inverse.shape[0], inverse.shape[1]
    for t in range(frames - 1, -1, -1):
        for i in range(m):
            for j in range(m):
                inverse[t, i, j] = factor.inverse[t, i, j]
                first[t, i, j] = 0.0
                second[t, i, j] = 0.0
        if t + 1 < frames:
            _subtract(inverse[t + 1], factor.first[t], m, first[t])
        if t + 2 < frames:
            _subtract_transposed(first[t + 1], factor.second[t], m, False, first[t])
            _subtract(first[t + 1], factor.first[t], m, second[t])
            _subtract(inverse[t + 2], factor.second[t], m, second[t])
        if t + 1 < frames:
            _subtract_transposed(first[t], factor.first[t], m, True, inverse[t])
        if t + 2 < frames:
            _subtract_transposed(second[t], factor.second[t], m, True, inverse[t])
        for i in range(m):
            for j in range(i):
                inverse[t, j, i] = inverse[t, i, j]


@vectorized
def _subtract(left, right, m, out):
    """Compute ``out -= left right``; the columns are those of ``out``.

    Four terms are subtracted at a time, so that each row is read and written a quarter as often.
    """
    columns = out.shape[1]
    for i in range(m):
        for k in range(0, m - 3, 4):
            a, b, c, d = left[i, k], left[i, k + 1], left[i, k + 2], left[i, k + 3]
            for j in range(columns):
                out[i, j] -= a * right[k, j] + b * right[k + 1, j] + c * right[k + 2, j] + d * right[k + 3, j]
        for k in range(m - m % 4, m):
            multiplier = left[i, k]
            for j in range(columns):
                out[i, j] -= multiplier * right[k, j]


@vectorized
def _subtract_transposed(left, right, m, lower, out):
    """Compute ``out -= left^T right``, or its lower triangle only; the columns are those of ``out``.

    Four terms are subtracted at a time, as in :func:`_subtract`.
    """
    columns = out.shape[1]
    for k in range(0, m - 3, 4):
        for i in range(m):
            a, b, c, d = left[k, i], left[k + 1, i], left[k + 2, i], left[k + 3, i]
            for j in range(i + 1 if lower else columns):
                out[i, j] -= a * right[k, j] + b * right[k + 1, j] + c * right[k + 2, j] + d * right[k + 3, j]
    for k in range(m - m % 4, m):
        for i in range(m):
            multiplier = left[k, i]
            for j in range(i + 1 if lower else columns):
                out[i, j] -= multiplier * right[k, j]
