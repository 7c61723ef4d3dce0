"""Relative pose of two views from corresponding rays: errors of hypotheses, and robust refinement.

Errors are Sampson distances on the unit sphere (Hartley and Zisserman 2004, section 11.4, for rays instead of image
points), in units of the noise, so that any lens is possible.
"""

import math

import numpy as np

from posefuse.kernels.jit import kernel, subroutine
from posefuse.kernels.linear_algebra.rotations import exponential
from posefuse.kernels.linear_algebra.symmetric import cholesky, cholesky_solve
from posefuse.kernels.linear_algebra.tangents import tangents_of

RAY_A, RAY_B, VELOCITY, VARIANCE_A, VARIANCE_B, COLUMNS = 0, 3, 6, 9, 10, 11
"""Columns of a table of points: unit rays of both views, change of the second ray per second, and the variance of the
direction per axis in both views, in rad^2."""

N_PARAMETERS = 6
"""Three rotations, two tangents of the translation, and the time offset."""

STUDENT_T_DOF = 3.0
_MIN_GAIN = 1e-5
_MAX_DAMPING = 1e4


@subroutine
def _error(e, points, i, shift_s, ray, normal):
    """Return the signed epipolar error of a point and its standard deviation.

    Writes the second ray, moved by ``shift_s``, and the normal of its epipolar plane.
    """
    ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
    for j in range(3):
        ray[j] = points[i, RAY_B + j] + shift_s * points[i, VELOCITY + j]
        normal[j] = e[j, 0] * ax + e[j, 1] * ay + e[j, 2] * az
    error = normal[0] * ray[0] + normal[1] * ray[1] + normal[2] * ray[2]
    # Only the parts of the normals across the rays move the error.
    across_b = normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2 - error * error
    across_a = -error * error
    for j in range(3):
        q = e[0, j] * ray[0] + e[1, j] * ray[1] + e[2, j] * ray[2]
        across_a += q * q
    variance = points[i, VARIANCE_B] * across_b + points[i, VARIANCE_A] * across_a
    return error, math.sqrt(max(variance, 1e-30))


@subroutine
def _essential(rotation, translation, out):
    """Write the essential matrix ``[t]x R``."""
    x, y, z = translation[0], translation[1], translation[2]
    for j in range(3):
        r0, r1, r2 = rotation[0, j], rotation[1, j], rotation[2, j]
        out[0, j] = -z * r1 + y * r2
        out[1, j] = z * r0 - x * r2
        out[2, j] = -y * r0 + x * r1


@kernel
def epipolar_costs(essentials, points, costs):
    """Write the mean robust cost of essential matrices.

    Args:
        essentials: shape (hypothesis, 3, 3): ``b^T E a = 0``.
        points: shape (point, COLUMNS).
        costs: shape (hypothesis,), written: mean of ``log(1 + r^2 / nu)``.
    """
    n = points.shape[0]
    ray, normal = np.empty(3), np.empty(3)
    for h in range(essentials.shape[0]):
        total = 0.0
        for i in range(n):
            error, sd = _error(essentials[h], points, i, 0.0, ray, normal)
            total += math.log1p(error * error / (sd * sd * STUDENT_T_DOF))
        costs[h] = total / max(n, 1)


@kernel
def epipolar_residuals(rotation, translation, points, residuals):
    """Write the Sampson distances of points in units of the noise, NaN where a ray is missing.

    Args:
        rotation: shape (3, 3), second view from first.
        translation: shape (3,), a unit vector.
        points: shape (point, COLUMNS), NaN where missing.
        residuals: shape (point,), written.
    """
    e, ray, normal = np.empty((3, 3)), np.empty(3), np.empty(3)
    _essential(rotation, translation, e)
    for i in range(points.shape[0]):
        error, sd = _error(e, points, i, 0.0, ray, normal)
        residuals[i] = error / sd


@subroutine
def _row(pose, tangents, points, i, ray, normal, row):
    """Write the derivatives of the epipolar error ``b . (t x R a)`` by the parameters.

    Args:
        pose: shape (4, 3): rotation, and translation in the last row.
    """
    ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
    rx = pose[0, 0] * ax + pose[0, 1] * ay + pose[0, 2] * az
    ry = pose[1, 0] * ax + pose[1, 1] * ay + pose[1, 2] * az
    rz = pose[2, 0] * ax + pose[2, 1] * ay + pose[2, 2] * az
    bx, by, bz = ray[0], ray[1], ray[2]
    tx, ty, tz = pose[3, 0], pose[3, 1], pose[3, 2]
    # (b x t) . (w x R a) = w . (R a x (b x t)).
    cx, cy, cz = by * tz - bz * ty, bz * tx - bx * tz, bx * ty - by * tx
    row[0] = ry * cz - rz * cy
    row[1] = rz * cx - rx * cz
    row[2] = rx * cy - ry * cx
    # b . (d x R a) = d . (R a x b).
    mx, my, mz = ry * bz - rz * by, rz * bx - rx * bz, rx * by - ry * bx
    for k in range(2):
        row[3 + k] = tangents[k, 0] * mx + tangents[k, 1] * my + tangents[k, 2] * mz
    row[5] = 0.0
    for j in range(3):
        row[5] += normal[j] * points[i, VELOCITY + j]


@subroutine
def _normal_equations(pose, e, tangents, points, shift_s, work):
    """Write the normal equations of the robust cost to ``work``, and return the cost.

    Args:
        work: shape (at least 9, 6): matrix (lower triangle), negative gradient, and scratch.
    """
    _essential(pose, pose[3], e)
    tangents_of(pose[3], tangents)
    for j in range(N_PARAMETERS + 1):
        for k in range(N_PARAMETERS):
            work[j, k] = 0.0
    row, ray, normal = work[7], work[8, :3], work[8, 3:]
    total = 0.0
    for i in range(points.shape[0]):
        error, sd = _error(e, points, i, shift_s, ray, normal)
        _row(pose, tangents, points, i, ray, normal, row)
        squared = error * error / (sd * sd)
        total += math.log1p(squared / STUDENT_T_DOF)
        weight = 1.0 / ((STUDENT_T_DOF + squared) * sd * sd)
        for j in range(N_PARAMETERS):
            weighted = weight * row[j]
            work[N_PARAMETERS, j] -= weighted * error
            for k in range(j + 1):
                work[j, k] += weighted * row[k]
    return 0.5 * total


@subroutine
def _move(pose, tangents, step, out):
    """Write the pose after a step."""
    w = exponential(step[0], step[1], step[2])
    for j in range(3):
        r0, r1, r2 = pose[0, j], pose[1, j], pose[2, j]
        out[0, j] = w[0] * r0 + w[1] * r1 + w[2] * r2
        out[1, j] = w[3] * r0 + w[4] * r1 + w[5] * r2
        out[2, j] = w[6] * r0 + w[7] * r1 + w[8] * r2
    squared = 0.0
    for j in range(3):
        out[3, j] = pose[3, j] + step[3] * tangents[0, j] + step[4] * tangents[1, j]
        squared += out[3, j] ** 2
    for j in range(3):
        out[3, j] /= math.sqrt(squared)


@kernel
def refine_relative_pose(pose, points, max_steps, max_shift_s):
    """Refine a relative pose, and the time offset at constant velocities, by Levenberg-Marquardt on a Student-t cost.

    Args:
        pose: shape (4, 3), in and out: rotation of the second view from the first, and unit translation.
        points: shape (point, COLUMNS); velocities of 0 keep the time offset.
        max_steps: bound on the number of steps.
        max_shift_s: bound on the change of the time offset.

    Returns:
        The time by which the second rays are moved along their velocities, and the mean cost of a point.
    """
    e, tangents, work = np.empty((3, 3)), np.empty((2, 3)), np.zeros((N_PARAMETERS + 3, N_PARAMETERS))
    new_e, new_tangents, new_work = np.empty((3, 3)), np.empty((2, 3)), np.zeros((N_PARAMETERS + 3, N_PARAMETERS))
    step, system, new_pose = np.empty(N_PARAMETERS), np.empty((N_PARAMETERS, N_PARAMETERS)), np.empty((4, 3))
    shift_s, damping = 0.0, 1e-3
    cost = _normal_equations(pose, e, tangents, points, shift_s, work)
    for _ in range(max_steps):
        trace = 0.0
        for j in range(N_PARAMETERS):
            trace += work[j, j]
        for j in range(N_PARAMETERS):
            step[j] = work[N_PARAMETERS, j]
            for k in range(j + 1):
                system[j, k] = work[j, k]
            system[j, j] = work[j, j] * (1.0 + damping) + 1e-12 * trace + 1e-300
        if not cholesky(system, N_PARAMETERS):
            break
        cholesky_solve(system, N_PARAMETERS, step)
        new_shift_s = min(max(shift_s + step[5], -max_shift_s), max_shift_s)
        _move(pose, tangents, step, new_pose)
        new_cost = _normal_equations(new_pose, new_e, new_tangents, points, new_shift_s, new_work)
        if new_cost < cost:
            gain = cost - new_cost
            pose[:], e[:], tangents[:], work[:] = new_pose, new_e, new_tangents, new_work
            cost, shift_s = new_cost, new_shift_s
            damping = max(0.2 * damping, 1e-7)
            if gain < _MIN_GAIN * cost:
                break
        else:
            damping *= 8.0
            if damping > _MAX_DAMPING:
                break
    return shift_s, 2.0 * cost / max(points.shape[0], 1)
