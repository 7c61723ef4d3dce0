"""Fit of a pose to points in space: damped Gauss-Newton on squared distances and joint limits, at a fixed shape."""

import math
from collections import namedtuple

import numpy as np

from posefuse.kernels.jit import inline, kernel, subroutine
from posefuse.kernels.linear_algebra.symmetric import cholesky, cholesky_solve
from posefuse.kernels.tracking.body_kinematics import apply_increment, locate_nodes, node_jacobian
from posefuse.kernels.tracking.joint_limits import HINGE, TWIST, add_limit, add_twist
from posefuse.kernels.tracking.update import copy_rotations

FitWorkspace = namedtuple("FitWorkspace", "nodes jacobian hessian gradient")
"""Scratch arrays of a fit: node positions, their Jacobian (zero at first), the lower triangle of the Hessian, and the
negative gradient.
"""

_FIRST_DAMPING = 1e-6
_MAX_DAMPING = 1e6
_DAMPING_FACTOR = 10.0
_SMALL_STEP = 1e-10


@subroutine
def _build_equations(body, pose, points, weight, stiffness, workspace):
    """Build the normal equations of a pose; return half the sum of squared distances and limit violations.

    Args:
        body: a Body.
        pose: a Pose.
        points: shape (keypoint, 3), NaN where the pose is free.
        weight: weight of a squared distance, 1/m^2.
        stiffness: weight of a squared violation of a joint limit.
        workspace: a FitWorkspace.
    """
    nodes, jacobian, hessian, gradient = workspace
    n = gradient.shape[0]
    locate_nodes(body, pose, nodes)
    node_jacobian(body, pose, n, jacobian)
    cost = 0.0
    for i in range(n):
        gradient[i] = 0.0
        for j in range(i + 1):
            hessian[i, j] = 0.0
    for k in range(points.shape[0]):
        node = body.keypoint_nodes[k]
        if node < 0 or not math.isfinite(points[k, 0] + points[k, 1] + points[k, 2]):
            continue
        for axis in range(3):
            off = points[k, axis] - nodes[node, axis]
            cost += 0.5 * weight * off * off
            for i in range(n):
                slope = weight * jacobian[node, axis, i]
                gradient[i] += slope * off
                for j in range(i + 1):
                    hessian[i, j] += slope * jacobian[node, axis, j]
    for limit in range(body.limits.shape[0]):
        if body.limits[limit, 0] == TWIST:
            cost += add_twist(body, limit, stiffness, pose.turns, hessian, gradient)
        else:
            cost += add_limit(body, limit, stiffness, pose.turns, pose.bones, hessian, gradient)
            _add_limit_of_segment(body, limit, stiffness, pose.turns, pose.bones, hessian, gradient)
    return cost


@inline
def _cross(a, b):
    """Return the cross product of two tuples."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline
def _column(matrix, c):
    """Return a column of a matrix of three rows as a tuple."""
    return matrix[0, c], matrix[1, c], matrix[2, c]


@inline
def _dot(a, b):
    """Return the product of two tuples."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@subroutine
def _add_limit_of_segment(body, limit, stiffness, turns, bones, hessian, gradient):
    """Add the derivatives of a bone's limit by the turn of the segment that carries the limit's axis.

    :func:`posefuse.kernels.tracking.joint_limits.add_limit` adds those by the bones. The value of a limit is
    ``axis . m``, where m is the direction of the bone, or for a hinge the cross product of both directions.
    """
    bone, before, segment = body.limits[limit, 1], body.limits[limit, 2], body.limits[limit, 3]
    is_hinge = body.limits[limit, 0] == HINGE
    axes = turns[segment]
    axis = (body.limit_axes[limit, 0], body.limit_axes[limit, 1], body.limit_axes[limit, 2])
    x, y, z = _column(axes, 0), _column(axes, 1), _column(axes, 2)
    world = (
        x[0] * axis[0] + y[0] * axis[1] + z[0] * axis[2],
        x[1] * axis[0] + y[1] * axis[1] + z[1] * axis[2],
        x[2] * axis[0] + y[2] * axis[1] + z[2] * axis[2],
    )
    far, near = _column(bones[bone], 2), _column(bones[before], 2)
    m = _cross(near, far) if is_hinge else far
    violation = body.limit_axes[limit, 3] - _dot(world, m)
    if violation <= 0.0:
        return
    slope = _cross(axis, (_dot(x, m), _dot(y, m), _dot(z, m)))
    first, row = 3 + 3 * turns.shape[0], 3 + 3 * segment
    # The value is linear in the direction of each bone, with these coefficients.
    by_far = _cross(world, near) if is_hinge else world
    by_near = _cross(far, world)
    for i in range(3):
        gradient[row + i] += stiffness * violation * slope[i]
        for j in range(i + 1):
            hessian[row + i, row + j] += stiffness * slope[i] * slope[j]
        column = first + 2 * bone
        hessian[column, row + i] -= stiffness * slope[i] * _dot(by_far, _column(bones[bone], 1))
        hessian[column + 1, row + i] += stiffness * slope[i] * _dot(by_far, _column(bones[bone], 0))
        if is_hinge:
            column = first + 2 * before
            hessian[column, row + i] -= stiffness * slope[i] * _dot(by_near, _column(bones[before], 1))
            hessian[column + 1, row + i] += stiffness * slope[i] * _dot(by_near, _column(bones[before], 0))


@kernel
def fit_pose(body, pose, points, weight, stiffness, iterations):
    """Fit a pose to points, in place; what neither points nor limits determine stays.

    Args:
        body: a Body.
        pose: a Pose, in and out.
        points: shape (keypoint, 3), NaN where the pose is free.
        weight: weight of a squared distance, 1/m^2.
        stiffness: weight of a squared violation of a joint limit.
        iterations: maximum number of steps.

    Returns:
        The cost of the fitted pose.
    """
    n = 3 + 3 * pose.turns.shape[0] + 2 * pose.bones.shape[0]
    workspace = FitWorkspace(
        nodes=np.empty((body.parents.shape[0], 3)),
        jacobian=np.zeros((body.parents.shape[0], 3, n + pose.shape.shape[0])),
        hessian=np.empty((n, n)),
        gradient=np.empty(n),
    )
    lower, change = np.empty((n, n)), np.empty(n)
    root, turns, bones = pose.root.copy(), pose.turns.copy(), pose.bones.copy()
    cost = _build_equations(body, pose, points, weight, stiffness, workspace)
    damping = _FIRST_DAMPING
    for _ in range(iterations):
        for i in range(n):
            change[i] = workspace.gradient[i]
            for j in range(i + 1):
                lower[i, j] = workspace.hessian[i, j]
            lower[i, i] += damping * weight
        if not cholesky(lower, n):
            break
        cholesky_solve(lower, n, change)
        apply_increment(change, pose.root, pose.turns, pose.bones)
        after = _build_equations(body, pose, points, weight, stiffness, workspace)
        if after <= cost:
            is_done = cost - after <= _SMALL_STEP * cost
            cost = after
            damping = max(damping / _DAMPING_FACTOR, _FIRST_DAMPING)
            root[:] = pose.root
            copy_rotations(pose.turns, turns)
            copy_rotations(pose.bones, bones)
            if is_done:
                break
            continue
        # The cost rose: return to the best pose and take a shorter step.
        pose.root[:] = root
        copy_rotations(turns, pose.turns)
        copy_rotations(bones, pose.bones)
        damping *= _DAMPING_FACTOR
        if damping > _MAX_DAMPING:
            break
        _build_equations(body, pose, points, weight, stiffness, workspace)
    return cost
