"""Rotation matrices: exponential and logarithm map in body axes."""

import math

from posefuse.kernels.jit import inline, subroutine

_TINY = 1e-12


@inline
def exponential(a, b, c):
    """Return the matrix ``exp([a, b, c]x)``, row by row (Rodrigues)."""
    squared = a * a + b * b + c * c
    if squared < _TINY:
        sine = 1.0 - squared / 6.0
        versine = 0.5 - squared / 24.0
    else:
        angle = math.sqrt(squared)
        sine = math.sin(angle) / angle
        versine = (1.0 - math.cos(angle)) / squared
    return (
        1.0 - versine * (b * b + c * c),
        versine * a * b - sine * c,
        versine * a * c + sine * b,
        versine * a * b + sine * c,
        1.0 - versine * (a * a + c * c),
        versine * b * c - sine * a,
        versine * a * c - sine * b,
        versine * b * c + sine * a,
        1.0 - versine * (a * a + b * b),
    )


@subroutine
def rotate(matrix, a, b, c):
    """Rotate ``matrix``, shape (3, 3), by ``(a, b, c)`` radians about its own axes, in place, and orthonormalize it."""
    e = exponential(a, b, c)
    for i in range(3):
        x, y, z = matrix[i, 0], matrix[i, 1], matrix[i, 2]
        matrix[i, 0] = x * e[0] + y * e[3] + z * e[6]
        matrix[i, 1] = x * e[1] + y * e[4] + z * e[7]
        matrix[i, 2] = x * e[2] + y * e[5] + z * e[8]
    orthonormalize(matrix)


@subroutine
def orthonormalize(matrix):
    """Remove rounding errors from a rotation matrix, in place; its third axis keeps its direction."""
    inverse = 1.0 / math.sqrt(matrix[0, 2] ** 2 + matrix[1, 2] ** 2 + matrix[2, 2] ** 2)
    for i in range(3):
        matrix[i, 2] *= inverse
    along = matrix[0, 0] * matrix[0, 2] + matrix[1, 0] * matrix[1, 2] + matrix[2, 0] * matrix[2, 2]
    for i in range(3):
        matrix[i, 0] -= along * matrix[i, 2]
    inverse = 1.0 / math.sqrt(matrix[0, 0] ** 2 + matrix[1, 0] ** 2 + matrix[2, 0] ** 2)
    for i in range(3):
        matrix[i, 0] *= inverse
    # y = z x x
    matrix[0, 1] = matrix[1, 2] * matrix[2, 0] - matrix[2, 2] * matrix[1, 0]
    matrix[1, 1] = matrix[2, 2] * matrix[0, 0] - matrix[0, 2] * matrix[2, 0]
    matrix[2, 1] = matrix[0, 2] * matrix[1, 0] - matrix[1, 2] * matrix[0, 0]


@subroutine
def rotation_between(start, end):
    """Return the logarithm of ``start^T end``: the rotation in radians, in the axes of ``start``, to ``end``."""
    trace = 0.0
    for i in range(3):
        for j in range(3):
            trace += start[i, j] * end[i, j]
    cosine = 0.5 * (trace - 1.0)
    cosine = min(1.0, max(-1.0, cosine))
    a = b = c = 0.0
    for i in range(3):
        a += start[i, 2] * end[i, 1] - start[i, 1] * end[i, 2]
        b += start[i, 0] * end[i, 2] - start[i, 2] * end[i, 0]
        c += start[i, 1] * end[i, 0] - start[i, 0] * end[i, 1]
    sine = 0.5 * math.sqrt(a * a + b * b + c * c)
    angle = math.atan2(sine, cosine)
    scale = 0.5 if sine < 1e-9 else 0.5 * angle / sine
    return scale * a, scale * b, scale * c
