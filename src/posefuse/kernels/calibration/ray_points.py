"""Triangulation of rays by reweighted linear least squares."""

import math

import numpy as np

from posefuse.kernels.calibration.relative_pose import STUDENT_T_DOF
from posefuse.kernels.jit import kernel, subroutine


@kernel
def triangulate_rays(rotations, centers, observed, points):
    """Triangulate points by reweighted linear least squares; NaN with fewer than two views.

    A ray sees a point where the part of the point's distance across the ray is 0; errors are divided by the distance,
    and downweighted as Student-t errors.

    Args:
        rotations: shape (view, 3, 3).
        centers: shape (view, 3).
        observed: shape (sample, view, keypoint, 10).
        points: shape (sample, keypoint, 3), written.
    """
    n_views = rotations.shape[0]
    rays, weight = np.empty((n_views, 3)), np.empty(n_views)
    a, x = np.empty((3, 4)), np.empty(3)
    for s in range(observed.shape[0]):
        for k in range(observed.shape[2]):
            count = 0
            for v in range(n_views):
                weight[v] = 0.0
                if not math.isnan(observed[s, v, k, 0]):
                    count += 1
                    weight[v] = 1.0
                    for j in range(3):
                        rays[v, j] = 0.0
                        for i in range(3):
                            rays[v, j] += rotations[v, i, j] * observed[s, v, k, i]
            for j in range(3):
                points[s, k, j] = math.nan
            if count < 2:
                continue
            for _ in range(4):
                _sum_rays(rays, centers, weight, a)
                if not _solve_3(a, x):
                    break
                _reweight_rays(rays, centers, observed[s, :, k, 9], x, weight)
                for j in range(3):
                    points[s, k, j] = x[j]


@subroutine
def _sum_rays(rays, centers, weight, a):
    """Write the weighted normal equations of the nearest point to rays."""
    for i in range(3):
        for j in range(4):
            a[i, j] = 0.0
    for v in range(rays.shape[0]):
        if weight[v] > 0.0:
            for i in range(3):
                for j in range(3):
                    across = weight[v] * ((1.0 if i == j else 0.0) - rays[v, i] * rays[v, j])
                    a[i, j] += across
                    a[i, 3] += across * centers[v, j]


@subroutine
def _reweight_rays(rays, centers, sigma, x, weight):
    """Update the weights for a point."""
    for v in range(rays.shape[0]):
        if weight[v] > 0.0:
            squared = along = 0.0
            for j in range(3):
                d = x[j] - centers[v, j]
                squared += d * d
                along += d * rays[v, j]
            error = max(squared - along * along, 0.0) / max(squared, 1e-12)
            variance = sigma[v] * sigma[v]
            weight[v] = 1.0 / ((STUDENT_T_DOF + error / variance) * variance * max(squared, 1e-12))


@subroutine
def _solve_3(a, x):
    """Solve three equations by Cramer's rule; return False if they are singular."""
    c0 = a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]
    c1 = a[1, 2] * a[2, 0] - a[1, 0] * a[2, 2]
    c2 = a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0]
    determinant = a[0, 0] * c0 + a[0, 1] * c1 + a[0, 2] * c2
    size = (a[0, 0] + a[1, 1] + a[2, 2]) / 3.0
    if not abs(determinant) > 1e-10 * size * size * size:
        return False
    x[0] = (
        a[0, 3] * c0
        + a[0, 1] * (a[1, 2] * a[2, 3] - a[1, 3] * a[2, 2])
        + a[0, 2] * (a[1, 3] * a[2, 1] - a[1, 1] * a[2, 3])
    ) / determinant
    x[1] = (
        a[0, 0] * (a[1, 3] * a[2, 2] - a[1, 2] * a[2, 3])
        + a[0, 3] * c1
        + a[0, 2] * (a[1, 0] * a[2, 3] - a[1, 3] * a[2, 0])
    ) / determinant
    x[2] = (
        a[0, 0] * (a[1, 1] * a[2, 3] - a[1, 3] * a[2, 1])
        + a[0, 1] * (a[1, 3] * a[2, 0] - a[1, 0] * a[2, 3])
        + a[0, 3] * c2
    ) / determinant
    return True
