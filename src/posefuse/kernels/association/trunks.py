"""Centers of trunks from their corners, by a small linear model with prior sizes and robust weights.

Each keypoint i is ``sum_a design[i, a] x_a`` with 3D vectors ``x_a``. The first is the center, which has no
informative prior; the others are normally distributed about 0. See :mod:`posefuse.association.trunk`.
"""

import math

import numpy as np

from posefuse.kernels.jit import kernel, subroutine
from posefuse.kernels.linear_algebra.symmetric_3x3 import invert_symmetric

_ITERATIONS = 6
_NU = 3.0


@subroutine
def _invert(matrix, inverse):
    """Invert a symmetric positive definite matrix by Gauss-Jordan elimination; both arrays are overwritten."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(n):
            inverse[i, j] = 1.0 if i == j else 0.0
    for i in range(n):
        pivot = 1.0 / matrix[i, i]
        for j in range(n):
            matrix[i, j] *= pivot
            inverse[i, j] *= pivot
        for k in range(n):
            factor = matrix[k, i] if k != i else 0.0
            if factor != 0.0:
                for j in range(n):
                    matrix[k, j] -= factor * matrix[i, j]
                    inverse[k, j] -= factor * inverse[i, j]


@subroutine
def _invert_covariances(points, covariance, floor_m, person, corners, information):
    """Write the inverse covariances of the corners (column 6 flags validity); return their count and mean."""
    x = 0.0
    y = 0.0
    z = 0.0
    n_corners = 0
    for i in range(len(corners)):
        k = corners[i]
        information[i, 6] = 0.0
        if not math.isfinite(points[person, k, 0] + points[person, k, 1] + points[person, k, 2]):
            continue
        n_corners += 1
        x += points[person, k, 0]
        y += points[person, k, 1]
        z += points[person, k, 2]
        information[i, 6] = 1.0
        floor_squared = floor_m * floor_m
        c = covariance
        _, information[i, 0], information[i, 1], information[i, 2], information[i, 3], information[i, 4], xx = (
            invert_symmetric(
                c[person, k, 0] + floor_squared,
                c[person, k, 1],
                c[person, k, 2],
                c[person, k, 3] + floor_squared,
                c[person, k, 4],
                c[person, k, 5] + floor_squared,
            )
        )
        information[i, 5] = xx
    return n_corners, x / n_corners, y / n_corners, z / n_corners


@subroutine
def _accumulate(points, corners, design, information, weight, origin, matrix, right):
    """Add the weighted normal equations of all corners."""
    n_vectors = design.shape[1]
    for i in range(len(corners)):
        if information[i, 6] == 0.0:
            continue
        for a in range(n_vectors):
            for p in range(3):
                factor = weight[i] * design[i, a]
                for q in range(3):
                    value = factor * _symmetric_entry(information, i, p, q)
                    right[3 * a + p] += value * (points[corners[i], q] - origin[q])
                    for b in range(n_vectors):
                        matrix[3 * a + p, 3 * b + q] += value * design[i, b]


@subroutine
def _symmetric_entry(information, i, p, q):
    """Return an entry of a symmetric 3x3 matrix stored as six numbers."""
    first = min(p, q)
    second = max(p, q)
    return information[i, second if first == 0 else (2 + second if first == 1 else 5)]


@subroutine
def _update_weights(points, corners, design, information, origin, solution, weight):
    """Update the Student t weights of the corners from their residuals."""
    for i in range(len(corners)):
        total = 0.0
        for p in range(3):
            for q in range(3):
                residual_p = points[corners[i], p] - origin[p]
                residual_q = points[corners[i], q] - origin[q]
                for a in range(design.shape[1]):
                    residual_p -= design[i, a] * solution[3 * a + p]
                    residual_q -= design[i, a] * solution[3 * a + q]
                total += residual_p * residual_q * _symmetric_entry(information, i, p, q)
        weight[i] = (_NU + 3.0) / (_NU + total)


@kernel
def estimate_trunk_centers(points, covariance, corners, design, sizes_m, floor_m, centers, covariances):
    """Estimate the centers of trunks and their covariances.

    Args:
        points: shape (person, keypoint, 3), NaN where missing.
        covariance: shape (person, keypoint, 6).
        corners: shape (corner,), int64: keypoints.
        design: shape (corner, vector).
        sizes_m: shape (vector,): prior standard deviations of the vectors; that of the center is wide.
        floor_m: standard deviation that is added in quadrature to those of the points.
        centers: shape (person, 3), written; NaN without any valid corner.
        covariances: shape (person, 6), written.
    """
    n = 3 * design.shape[1]
    matrix = np.empty((n, n))
    inverse = np.empty((n, n))
    right = np.empty(n)
    solution = np.empty(n)
    weight = np.empty(len(corners))
    information = np.empty((len(corners), 7))
    origin = np.empty(3)
    for person in range(len(points)):
        n_corners, origin[0], origin[1], origin[2] = _invert_covariances(
            points, covariance, floor_m, person, corners, information
        )
        if n_corners == 0:
            centers[person] = math.nan
            covariances[person] = math.nan
            continue
        weight[:] = 1.0
        for iteration in range(_ITERATIONS):
            matrix[:] = 0.0
            right[:] = 0.0
            for i in range(n):
                matrix[i, i] = 1.0 / (sizes_m[i // 3] * sizes_m[i // 3])
            _accumulate(points[person], corners, design, information, weight, origin, matrix, right)
            _invert(matrix, inverse)
            for i in range(n):
                solution[i] = 0.0
                for j in range(n):
                    solution[i] += inverse[i, j] * right[j]
            if iteration < _ITERATIONS - 1:
                _update_weights(points[person], corners, design, information, origin, solution, weight)
        for p in range(3):
            centers[person, p] = origin[p] + solution[p]
        covariances[person, 0] = inverse[0, 0]
        covariances[person, 1] = inverse[0, 1]
        covariances[person, 2] = inverse[0, 2]
        covariances[person, 3] = inverse[1, 1]
        covariances[person, 4] = inverse[1, 2]
        covariances[person, 5] = inverse[2, 2]
