"""Terms of a bundle adjustment over cameras and moving bodies with rigid bones, on viewing directions."""

import math

import numpy as np

from posefuse.kernels.jit import kernel, subroutine
from posefuse.kernels.linear_algebra.rotations import exponential
from posefuse.kernels.linear_algebra.symmetric import cholesky, cholesky_solve
from posefuse.kernels.linear_algebra.tangents import tangents_of

ROTATION, CENTER, OFFSET, FOCAL, VIEW_COLUMNS = 0, 3, 6, 7, 8
"""Columns of the parameters of a view: rotation about the camera's axes, center, time offset, logarithm of the focal
length. The logarithms of the lengths of bones follow after all views."""

STUDENT_T_DOF = 3.0
_MIN_COSINE = 0.05


@subroutine
def _observation(rotation, center, point, observed, row, tangents):
    """Write the residuals of an observation and their derivatives; return False if the point is not in front.

    Args:
        observed: shape (10,): ray, its change per second and per logarithm of the focal length, and the noise in rad.
        row: shape (2, VIEW_COLUMNS + 4): derivatives by the view and by the point, and the residual.
    """
    px = py = pz = 0.0
    for j in range(3):
        d = point[j] - center[j]
        px += rotation[0, j] * d
        py += rotation[1, j] * d
        pz += rotation[2, j] * d
    depth = px * observed[0] + py * observed[1] + pz * observed[2]
    length = math.sqrt(px * px + py * py + pz * pz)
    if not depth > _MIN_COSINE * length:
        return False
    tangents_of(observed, tangents)
    for i in range(2):
        tx, ty, tz = tangents[i, 0], tangents[i, 1], tangents[i, 2]
        along = (tx * px + ty * py + tz * pz) / depth
        scale = 1.0 / (depth * observed[9])
        ax = (tx - along * observed[0]) * scale
        ay = (ty - along * observed[1]) * scale
        az = (tz - along * observed[2]) * scale
        # A rotation w moves p by w x p.
        row[i, 0] = az * py - ay * pz
        row[i, 1] = ax * pz - az * px
        row[i, 2] = ay * px - ax * py
        for j in range(3):
            by_point = ax * rotation[0, j] + ay * rotation[1, j] + az * rotation[2, j]
            row[i, CENTER + j] = -by_point
            row[i, VIEW_COLUMNS + j] = by_point
        row[i, OFFSET] = -(tx * observed[3] + ty * observed[4] + tz * observed[5]) / observed[9]
        # The noise in rad decreases by the same factor as the angles.
        by_focal = tx * observed[6] + ty * observed[7] + tz * observed[8]
        row[i, FOCAL] = (along - by_focal) / observed[9]
        row[i, VIEW_COLUMNS + 3] = along / observed[9]
    return True


@subroutine
def _add_observation(row, weight, first, k, matrix, mixed, views):
    """Add the terms of one observation; the last columns of ``mixed`` and ``views`` are gradients."""
    last = mixed.shape[1] - 1
    for i in range(2):
        residual = row[i, VIEW_COLUMNS + 3]
        for j in range(3):
            weighted = weight * row[i, VIEW_COLUMNS + j]
            for m in range(3):
                matrix[3 * k + j, 3 * k + m] += weighted * row[i, VIEW_COLUMNS + m]
            for c in range(VIEW_COLUMNS):
                mixed[3 * k + j, first + c] += weighted * row[i, c]
            mixed[3 * k + j, last] += weighted * residual
        for c in range(VIEW_COLUMNS):
            weighted = weight * row[i, c]
            views[first + c, last] += weighted * residual
            for d in range(VIEW_COLUMNS):
                views[first + c, first + d] += weighted * row[i, d]


@subroutine
def _add_bone(points, bone, log_length, sd, column, matrix, mixed, views):
    """Add the terms of one bone and return its cost; a bone without one of its ends has none."""
    a, b = bone[0], bone[1]
    squared = 0.0
    for j in range(3):
        squared += (points[b, j] - points[a, j]) ** 2
    if not squared > 0.0:
        return 0.0
    residual = (0.5 * math.log(squared) - log_length) / sd
    weight = (STUDENT_T_DOF + 1.0) / (STUDENT_T_DOF + residual * residual)
    last = mixed.shape[1] - 1
    for j in range(3):
        by_j = (points[b, j] - points[a, j]) / (squared * sd)
        for m in range(3):
            product = weight * by_j * (points[b, m] - points[a, m]) / (squared * sd)
            matrix[3 * a + j, 3 * a + m] += product
            matrix[3 * b + j, 3 * b + m] += product
            matrix[3 * a + j, 3 * b + m] -= product
            matrix[3 * b + j, 3 * a + m] -= product
        mixed[3 * a + j, column] += weight * by_j / sd
        mixed[3 * b + j, column] -= weight * by_j / sd
        mixed[3 * a + j, last] -= weight * by_j * residual
        mixed[3 * b + j, last] += weight * by_j * residual
    views[column, column] += weight / (sd * sd)
    views[column, last] -= weight * residual / sd
    return 0.5 * (STUDENT_T_DOF + 1.0) * math.log1p(residual * residual / STUDENT_T_DOF)


@kernel
def body_terms(rotations, centers, points, log_lengths, observed, scale, bones, terms):
    """Add the terms of the normal equations, and return the cost: a negative log-likelihood with Student-t errors.

    Args:
        rotations: shape (view, 3, 3), camera from world.
        centers: shape (view, 3).
        points: shape (sample, keypoint, 3), NaN where unknown.
        log_lengths: shape (sample, bone): logarithm of the length of each bone.
        observed: shape (sample, view, keypoint, 10): ray, its change per second and per logarithm of the focal length,
            and its standard deviation in rad; NaN where missing.
        scale: shape (view,): factor of the standard deviations.
        bones: (keypoints (bone, 2), standard deviation of the logarithm (bone,), column (sample, bone) among the
            parameters).
        terms: matrices of the points (sample, 3 keypoints, 3 keypoints), mixed terms (sample, 3 keypoints, parameter +
            1) and matrix of the parameters (parameter, parameter + 1), in and out; the last columns are gradients.
    """
    matrices, mixed, views = terms
    row, tangents = np.empty((2, VIEW_COLUMNS + 4)), np.empty((2, 3))
    ends, sds, columns = bones
    cost = 0.0
    behind = 0.5 * (STUDENT_T_DOF + 2.0) * math.log1p(1e4 / STUDENT_T_DOF)
    for s in range(points.shape[0]):
        for v in range(rotations.shape[0]):
            for k in range(points.shape[1]):
                if math.isnan(observed[s, v, k, 0]) or math.isnan(points[s, k, 0]):
                    continue
                if not _observation(rotations[v], centers[v], points[s, k], observed[s, v, k], row, tangents):
                    cost += behind
                    continue
                for i in range(2):
                    for c in range(VIEW_COLUMNS + 4):
                        row[i, c] /= scale[v]
                squared = row[0, VIEW_COLUMNS + 3] ** 2 + row[1, VIEW_COLUMNS + 3] ** 2
                weight = (STUDENT_T_DOF + 2.0) / (STUDENT_T_DOF + squared)
                cost += 0.5 * (STUDENT_T_DOF + 2.0) * math.log1p(squared / STUDENT_T_DOF)
                _add_observation(row, weight, VIEW_COLUMNS * v, k, matrices[s], mixed[s], views)
        for e in range(ends.shape[0]):
            if not (math.isnan(points[s, ends[e, 0], 0]) or math.isnan(points[s, ends[e, 1], 0])):
                cost += _add_bone(
                    points[s], ends[e], log_lengths[s, e], sds[e], columns[s, e], matrices[s], mixed[s], views
                )
    return cost


@kernel
def eliminate_points(matrices, mixed, damping, reduced):
    """Factorize the matrices of the points, and add the terms that their elimination subtracts.

    Args:
        matrices: shape (sample, row, row), in and out: lower triangular Cholesky factors of the damped matrices.
        mixed: shape (sample, row, parameter + 1), in and out: multiplied by the inverse factors.
        damping: relative increase of the diagonals.
        reduced: shape (parameter + 1, parameter + 1), in and out: lower triangle of the sum of squares of ``mixed``.
    """
    size, n = mixed.shape[1], mixed.shape[2]
    for s in range(matrices.shape[0]):
        for i in range(size):
            # A point without observations has no terms and does not move.
            diagonal = matrices[s, i, i]
            matrices[s, i, i] = (1.0 + damping) * diagonal + 1e-12 if diagonal > 0.0 else 1.0
        cholesky(matrices[s], size)
        for i in range(size):
            for k in range(i):
                factor = matrices[s, i, k]
                if factor != 0.0:
                    for c in range(n):
                        mixed[s, i, c] -= factor * mixed[s, k, c]
            inverse = 1.0 / matrices[s, i, i]
            for c in range(n):
                mixed[s, i, c] *= inverse
            for c in range(n):
                value = mixed[s, i, c]
                if value != 0.0:
                    for d in range(c + 1):
                        reduced[c, d] += value * mixed[s, i, d]


@kernel
def step_of_points(factors, mixed, change, steps):
    """Write the steps of the points for a change of the parameters.

    Args:
        factors: shape (sample, row, row): Cholesky factors.
        mixed: shape (sample, row, parameter + 1): multiplied by the inverse factors.
        change: shape (parameter,).
        steps: shape (sample, row), written.
    """
    size, n = mixed.shape[1], mixed.shape[2]
    for s in range(factors.shape[0]):
        for i in range(size):
            steps[s, i] = -mixed[s, i, n - 1]
            for c in range(n - 1):
                steps[s, i] -= mixed[s, i, c] * change[c]
        for i in range(size - 1, -1, -1):
            steps[s, i] /= factors[s, i, i]
            for k in range(i):
                steps[s, k] -= factors[s, i, k] * steps[s, i]


@kernel
def refine_view(rotation, center, points, observed, max_steps):
    """Refine the pose of one view from known points by Levenberg-Marquardt on a Student-t cost.

    Args:
        rotation: shape (3, 3), camera from world, in and out.
        center: shape (3,), in and out.
        points: shape (point, 3).
        observed: shape (point, 10).
        max_steps: bound on the steps.

    Returns:
        The mean cost ``log(1 + r^2 / nu)`` of a point.
    """
    work, new_work = np.zeros((9, 12)), np.zeros((9, 12))
    new_rotation, new_center, step = np.empty((3, 3)), np.empty(3), np.empty(6)
    cost, damping = _view_terms(rotation, center, points, observed, work), 1e-3
    for _ in range(max_steps):
        for j in range(6):
            step[j] = -work[6, j]
            for k in range(j + 1):
                work[j, 6 + k] = work[j, k]
            work[j, 6 + j] = work[j, j] * (1.0 + damping) + 1e-12
        if not cholesky(work[:6, 6:], 6):
            break
        cholesky_solve(work[:6, 6:], 6, step)
        w = exponential(step[0], step[1], step[2])
        for j in range(3):
            for i in range(3):
                new_rotation[i, j] = 0.0
                for k in range(3):
                    new_rotation[i, j] += w[3 * i + k] * rotation[k, j]
            new_center[j] = center[j] + step[3 + j]
        new_cost = _view_terms(new_rotation, new_center, points, observed, new_work)
        if new_cost < cost:
            gain = cost - new_cost
            rotation[:], center[:], work[:], cost = new_rotation, new_center, new_work, new_cost
            damping = max(0.2 * damping, 1e-7)
            if gain < 1e-4 * cost:
                break
        else:
            damping *= 8.0
            if damping > 1e5:
                break
    return cost / max(points.shape[0], 1)


@subroutine
def _view_terms(rotation, center, points, observed, work):
    """Write the normal equations of one pose to ``work``, shape (9, 12), and return the cost."""
    for j in range(7):
        for k in range(6):
            work[j, k] = 0.0
    total = 0.0
    # Rows 7 and 8 are scratch: the derivatives, of which the pose uses the first six.
    row, tangents = work[7:9], work[3:5, 6:9]
    for n in range(points.shape[0]):
        if not _observation(rotation, center, points[n], observed[n], row, tangents):
            total += math.log1p(1e4 / STUDENT_T_DOF)
            continue
        squared = row[0, VIEW_COLUMNS + 3] ** 2 + row[1, VIEW_COLUMNS + 3] ** 2
        total += math.log1p(squared / STUDENT_T_DOF)
        weight = 1.0 / (STUDENT_T_DOF + squared)
        for i in range(2):
            for j in range(6):
                weighted = weight * row[i, j]
                work[6, j] += weighted * row[i, VIEW_COLUMNS + 3]
                for k in range(j + 1):
                    work[j, k] += weighted * row[i, k]
    return total


@kernel
def body_residuals(rotations, centers, points, observed, residuals):
    """Write the length of each residual in units of the noise, NaN where missing and infinite behind the camera.

    Args:
        rotations: shape (view, 3, 3).
        centers: shape (view, 3).
        points: shape (sample, keypoint, 3).
        observed: shape (sample, view, keypoint, 10).
        residuals: shape (sample, view, keypoint), written.
    """
    row, tangents = np.empty((2, VIEW_COLUMNS + 4)), np.empty((2, 3))
    for s in range(points.shape[0]):
        for v in range(rotations.shape[0]):
            for k in range(points.shape[1]):
                residuals[s, v, k] = math.nan
                if math.isnan(observed[s, v, k, 0]) or math.isnan(points[s, k, 0]):
                    continue
                residuals[s, v, k] = math.inf
                if _observation(rotations[v], centers[v], points[s, k], observed[s, v, k], row, tangents):
                    residuals[s, v, k] = math.sqrt(row[0, VIEW_COLUMNS + 3] ** 2 + row[1, VIEW_COLUMNS + 3] ** 2)
