"""Coordinates across a direction."""

import math

from posefuse.kernels.jit import subroutine


@subroutine
def tangents_of(ray, out):
    """Write two unit vectors across a unit vector, shape (2, 3); their cross product is the vector."""
    k = 0
    for j in range(1, 3):
        if abs(ray[j]) < abs(ray[k]):
            k = j
    norm = math.sqrt(1.0 - ray[k] * ray[k])
    for j in range(3):
        out[0, j] = ((1.0 if j == k else 0.0) - ray[k] * ray[j]) / norm
    out[1, 0] = ray[1] * out[0, 2] - ray[2] * out[0, 1]
    out[1, 1] = ray[2] * out[0, 0] - ray[0] * out[0, 2]
    out[1, 2] = ray[0] * out[0, 1] - ray[1] * out[0, 0]
