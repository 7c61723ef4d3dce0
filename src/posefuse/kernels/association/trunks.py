"""The middle of a trunk from its corners: a small linear model with prior sizes, robustly weighted.

Every keypoint i is ``sum_a design[i, a] x_a`` with vectors ``x_a`` in space, the first the middle, of which nothing is
known, the others normally distributed about 0. See :mod:`posefuse.association.trunk`.
"""

import math

import numpy as np

from posefuse.kernels.cameras.points import invert_symmetric
from posefuse.kernels.jit import kernel, step

_ROUNDS = 6
_NU = 3.0


@step
def _invert(matrix, inverse):
    """Invert a symmetric positive definite matrix by Gauss and Jordan; both are overwritten."""
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


@step
def _informations(points, covariance, floor_m, person, chosen, information):
    """Inverse covariances of the chosen points, six numbers and whether there is one; and the mean of the points."""
    x = 0.0
    y = 0.0
    z = 0.0
    seen = 0
    for i in range(len(chosen)):
        k = chosen[i]
        information[i, 6] = 0.0
        if not math.isfinite(points[person, k, 0] + points[person, k, 1] + points[person, k, 2]):
            continue
        seen += 1
        x += points[person, k, 0]
        y += points[person, k, 1]
        z += points[person, k, 2]
        information[i, 6] = 1.0
        floor = floor_m * floor_m
        c = covariance
        _, information[i, 0], information[i, 1], information[i, 2], information[i, 3], information[i, 4], xx = (
            invert_symmetric(
                c[person, k, 0] + floor,
                c[person, k, 1],
                c[person, k, 2],
                c[person, k, 3] + floor,
                c[person, k, 4],
                c[person, k, 5] + floor,
            )
        )
        information[i, 5] = xx
    return seen, x / seen, y / seen, z / seen


@step
def _accumulate(points, person, chosen, design, information, weight, origin, matrix, right):
    """Add the weighted normal equations of all points."""
    parts = design.shape[1]
    for i in range(len(chosen)):
        if information[i, 6] == 0.0:
            continue
        for a in range(parts):
            for p in range(3):
                of_a = weight[i] * design[i, a]
                for q in range(3):
                    value = of_a * _entry(information, i, p, q)
                    right[3 * a + p] += value * (points[person, chosen[i], q] - origin[q])
                    for b in range(parts):
                        matrix[3 * a + p, 3 * b + q] += value * design[i, b]


@step
def _entry(information, i, p, q):
    """An entry of a symmetric matrix from its six numbers."""
    low = min(p, q)
    high = max(p, q)
    return information[i, high if low == 0 else (2 + high if low == 1 else 5)]


@step
def _reweigh(points, person, chosen, design, information, origin, solution, weight):
    """Student's t weights of the points from what is left of them."""
    for i in range(len(chosen)):
        total = 0.0
        for p in range(3):
            for q in range(3):
                off_p = points[person, chosen[i], p] - origin[p]
                off_q = points[person, chosen[i], q] - origin[q]
                for a in range(design.shape[1]):
                    off_p -= design[i, a] * solution[3 * a + p]
                    off_q -= design[i, a] * solution[3 * a + q]
                total += off_p * off_q * _entry(information, i, p, q)
        weight[i] = (_NU + 3.0) / (_NU + total)


@kernel
def trunk_middles(points, covariance, chosen, design, sizes_m, floor_m, middles, spreads):
    """Middles of trunks and their covariances.

    Args:
        points: shape (person, keypoint, 3), NaN where missing.
        covariance: shape (person, keypoint, 6).
        chosen: shape (corner,), int64: keypoints.
        design: shape (corner, part).
        sizes_m: shape (part,): standard deviations of the parts; the first is how little is known of the middle.
        floor_m: what is added to the points' standard deviations.
        middles: shape (person, 3), written; NaN where no corner is known.
        spreads: shape (person, 6), written.
    """
    n = 3 * design.shape[1]
    matrix = np.empty((n, n))
    inverse = np.empty((n, n))
    right = np.empty(n)
    solution = np.empty(n)
    weight = np.empty(len(chosen))
    information = np.empty((len(chosen), 7))
    origin = np.empty(3)
    for person in range(len(points)):
        seen, origin[0], origin[1], origin[2] = _informations(points, covariance, floor_m, person, chosen, information)
        if seen == 0:
            middles[person] = math.nan
            spreads[person] = math.nan
            continue
        weight[:] = 1.0
        for turn in range(_ROUNDS):
            matrix[:] = 0.0
            right[:] = 0.0
            for i in range(n):
                matrix[i, i] = 1.0 / (sizes_m[i // 3] * sizes_m[i // 3])
            _accumulate(points, person, chosen, design, information, weight, origin, matrix, right)
            _invert(matrix, inverse)
            for i in range(n):
                solution[i] = 0.0
                for j in range(n):
                    solution[i] += inverse[i, j] * right[j]
            if turn < _ROUNDS - 1:
                _reweigh(points, person, chosen, design, information, origin, solution, weight)
        for p in range(3):
            middles[person, p] = origin[p] + solution[p]
        spreads[person, 0] = inverse[0, 0]
        spreads[person, 1] = inverse[0, 1]
        spreads[person, 2] = inverse[0, 2]
        spreads[person, 3] = inverse[1, 1]
        spreads[person, 4] = inverse[1, 2]
        spreads[person, 5] = inverse[2, 2]
