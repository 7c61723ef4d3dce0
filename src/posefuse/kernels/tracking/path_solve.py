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
def _subtract_product(left, right, m, out):
    """Compute ``out -= left right^T``."""
    for i in range(m):
        for j in range(m):
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
            _subtract_product(factor.first[t], system.next[t + 1], m, system.diagonal[t + 1])
        if t + 2 < frames:
            far = system.second[t + 2]
            for i in range(m):
                for j in range(m):
                    factor.second[t, i, j] = far[i] * block[i, j]
            _subtract_product(factor.second[t], system.next[t + 1], m, system.next[t + 2])
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
            _subtract_transposed(factor.first[t], right[t + 1], m, right[t])
        if t + 2 < frames:
            _subtract_transposed(factor.second[t], right[t + 2], m, right[t])


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
            _subtract_transposed(first[t + 1], factor.second[t], m, first[t])
            _subtract(first[t + 1], factor.first[t], m, second[t])
            _subtract(inverse[t + 2], factor.second[t], m, second[t])
        if t + 1 < frames:
            _subtract_transposed(first[t], factor.first[t], m, inverse[t])
        if t + 2 < frames:
            _subtract_transposed(second[t], factor.second[t], m, inverse[t])
        # Asymmetry from rounding would grow from frame to frame.
        for i in range(m):
            for j in range(i):
                mean = 0.5 * (inverse[t, i, j] + inverse[t, j, i])
                inverse[t, i, j] = mean
                inverse[t, j, i] = mean


@vectorized
def _subtract(left, right, m, out):
    """Compute ``out -= left right``; the columns are those of ``out``."""
    for i in range(m):
        for k in range(m):
            multiplier = left[i, k]
            for j in range(out.shape[1]):
                out[i, j] -= multiplier * right[k, j]


@vectorized
def _subtract_transposed(left, right, m, out):
    """Compute ``out -= left^T right``; the columns are those of ``out``."""
    for k in range(m):
        for i in range(m):
            multiplier = left[k, i]
            for j in range(out.shape[1]):
                out[i, j] -= multiplier * right[k, j]
