"""Agreement of two views under one affine epipolar geometry, which needs no pose: a signal for their time offset."""

import math

import numpy as np

from posefuse.kernels.calibration.relative_pose import STUDENT_T_DOF
from posefuse.kernels.jit import kernel, subroutine
from posefuse.kernels.linear_algebra.symmetric import cholesky, cholesky_solve

_MIN_POINTS = 8
_REWEIGHTINGS = 4
_POWER_STEPS = 12


@subroutine
def _smallest_axis(c, scale, axis):
    """Write the axis across the line of smallest variance of four coordinates, by inverse iteration."""
    trace = 0.0
    for j in range(4):
        for k in range(j + 1):
            c[j, k] /= scale[j] * scale[k]
        trace += c[j, j]
        axis[j] = 0.5 if j % 2 == 0 else -0.4
    for j in range(4):
        c[j, j] += 1e-9 * trace
    if not cholesky(c, 4):
        return False
    for _ in range(_POWER_STEPS):
        cholesky_solve(c, 4, axis)
        norm = math.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2 + axis[3] ** 2)
        for j in range(4):
            axis[j] /= norm
    for j in range(4):
        axis[j] /= scale[j]
    return True


@subroutine
def _moments(z, weight, m, mean, c):
    """Write the weighted mean and covariance (lower triangle) of four coordinates."""
    total = 0.0
    for j in range(4):
        mean[j] = 0.0
        for k in range(4):
            c[j, k] = 0.0
    for i in range(m):
        total += weight[i]
        for j in range(4):
            mean[j] += weight[i] * z[i, j]
    for j in range(4):
        mean[j] /= total
    for i in range(m):
        for j in range(4):
            weighted = weight[i] * (z[i, j] - mean[j]) / total
            for k in range(j + 1):
                c[j, k] += weighted * (z[i, k] - mean[k])


@subroutine
def _reweight(z, variances, axis, mean, weight, m):
    """Update the weights for an axis, and return the mean cost."""
    across_a, across_b = axis[0] ** 2 + axis[1] ** 2, axis[2] ** 2 + axis[3] ** 2
    total = 0.0
    for i in range(m):
        error = 0.0
        for j in range(4):
            error += axis[j] * (z[i, j] - mean[j])
        squared = error * error / (across_a * variances[i, 0] + across_b * variances[i, 1])
        weight[i] = 1.0 / (STUDENT_T_DOF + squared)
        total += math.log1p(squared / STUDENT_T_DOF)
    return total / m


@kernel
def affine_costs(at_a, variance_a, at_b, variance_b, costs, counts):
    """Write how well one affine epipolar geometry explains two views, for several sets of points of the second view.

    In distant views, corresponding points satisfy one linear equation (Hartley and Zisserman 2004, section 14.1). It is
    the smallest principal component of the four image coordinates, reweighted for Student-t errors.

    Args:
        at_a: shape (point, 2): image plane coordinates in the first view, NaN where missing.
        variance_a: shape (point,).
        at_b: shape (set, point, 2): the same for the second view.
        variance_b: shape (set, point).
        costs: shape (set,), written: mean of ``log(1 + r^2 / nu)``; NaN with fewer than eight points.
        counts: shape (set,), int64, written: number of points.
    """
    n = at_a.shape[0]
    weight, z, variances = np.empty(n), np.empty((n, 4)), np.empty((n, 2))
    mean, c, scale, axis = np.empty(4), np.empty((4, 4)), np.empty(4), np.empty(4)
    for s in range(at_b.shape[0]):
        m = 0
        mean_a = mean_b = 0.0
        for i in range(n):
            if not (math.isnan(at_a[i, 0]) or math.isnan(at_b[s, i, 0])):
                z[m, 0], z[m, 1], z[m, 2], z[m, 3] = at_a[i, 0], at_a[i, 1], at_b[s, i, 0], at_b[s, i, 1]
                variances[m, 0], variances[m, 1] = variance_a[i], variance_b[s, i]
                mean_a += variance_a[i]
                mean_b += variance_b[s, i]
                weight[m] = 1.0
                m += 1
        counts[s] = m
        costs[s] = math.nan
        if m < _MIN_POINTS:
            continue
        for j in range(2):
            scale[j], scale[2 + j] = math.sqrt(mean_a / m), math.sqrt(mean_b / m)
        for _ in range(_REWEIGHTINGS):
            _moments(z, weight, m, mean, c)
            if not _smallest_axis(c, scale, axis):
                break
            costs[s] = _reweight(z, variances, axis, mean, weight, m)
