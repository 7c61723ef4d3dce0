"""Robust refinement of points over all views: Newton's method on a bounded cost, and selection of the inliers."""

import math

from posefuse.kernels.cameras.observation_rows import BLOCK, residual
from posefuse.kernels.cameras.points import (
    ACTIVE,
    BEHIND,
    COST,
    MAX_ITERATIONS,
    OK,
    SCALE,
    SINGULAR,
    SUM_ROWS,
    TOTAL,
    X,
    add_view,
    clear_sums,
    take_step,
)
from posefuse.kernels.jit import inline

_WIDE_ITERATIONS = 2


_QUICK_ITERATIONS = 4


# A cost this many times too high at the algebraic point of all views does not become acceptable by iteration.
_HOPELESS = 10.0


# Additional rows of the array of sums: the slope of the weight of each lane in the current view, and the resulting
# reduction of the second derivatives.
_WEIGHT_SLOPE = SUM_ROWS


CURVATURE = SUM_ROWS + 1


# If the determinant is reduced below this fraction, the Gauss-Newton matrix is used.
_MIN_DETERMINANT_RATIO = 0.1


@inline
def robust_equations(rows, weights, newton, state, full, none, sums):
    """Compute Newton's equations of the bounded cost: full weight within ``full``, zero weight beyond ``none``.

    Both limits are in squared sigmas. Between them the weight falls as ``(1 - u)^2`` with u from 0 to 1; the cost is
    its integral.
    """
    span = none - full
    inverse_span = 1.0 / span
    clear_sums(sums)
    falling = False
    for v in range(weights.shape[0]):
        n_between = 0
        for j in range(BLOCK):
            depth, r, s = residual(rows, v, j, state[X, j], state[X + 1, j], state[X + 2, j])
            weight = weights[v, j]
            squared = weight * (r * r + s * s)
            squared = squared if depth > 0.0 else none
            u = min(max((squared - full) * inverse_span, 0.0), 1.0)
            falloff = 1.0 - u
            add_view(rows, v, j, depth, r, s, weight * falloff * falloff, sums)
            cost = min(squared, full) + span * (1.0 - falloff * falloff * falloff) * (1.0 / 3.0)
            sums[TOTAL, j] += cost if weight > 0.0 else 0.0
            weight_slope = 4.0 * weight * weight * inverse_span * falloff if u > 0.0 else 0.0
            sums[_WEIGHT_SLOPE, j] = weight_slope
            n_between += 1 if weight_slope > 0.0 else 0
        if newton and n_between > 0:
            if not falling:
                for k in range(6):
                    for j in range(BLOCK):
                        sums[CURVATURE + k, j] = 0.0
            falling = True
            for j in range(BLOCK):
                _add_curvature(rows, v, j, state, sums)
    if falling:
        _apply_curvature(sums)


@inline
def _add_curvature(rows, v, j, state, sums):
    """Add the reduction of the second derivatives that is due to the falling weight of a view."""
    depth, r, s = residual(rows, v, j, state[X, j], state[X + 1, j], state[X + 2, j])
    inverse = 1.0 / depth
    along = r * r + s * s
    q0 = inverse * (r * rows[v, 0, j] + s * rows[v, 4, j] - along * rows[v, 8, j])
    q1 = inverse * (r * rows[v, 1, j] + s * rows[v, 5, j] - along * rows[v, 9, j])
    q2 = inverse * (r * rows[v, 2, j] + s * rows[v, 6, j] - along * rows[v, 10, j])
    w0 = sums[_WEIGHT_SLOPE, j] * q0
    w1 = sums[_WEIGHT_SLOPE, j] * q1
    w2 = sums[_WEIGHT_SLOPE, j] * q2
    sums[CURVATURE, j] += w0 * q0
    sums[CURVATURE + 1, j] += w0 * q1
    sums[CURVATURE + 2, j] += w0 * q2
    sums[CURVATURE + 3, j] += w1 * q1
    sums[CURVATURE + 4, j] += w1 * q2
    sums[CURVATURE + 5, j] += w2 * q2


@inline
def _apply_curvature(sums):
    """Replace the Gauss-Newton matrix by Newton's where that is positive definite and no step grows more than tenfold.

    If the derivatives ignored the falling weights, points with a view between the two limits would converge slowly, and
    the whole block would wait for them. The ratio of the determinants is the product of the fractions that remain along
    three directions, none of which exceeds one.
    """
    for j in range(BLOCK):
        xx = sums[0, j] - sums[CURVATURE, j]
        xy = sums[1, j] - sums[CURVATURE + 1, j]
        xz = sums[2, j] - sums[CURVATURE + 2, j]
        yy = sums[3, j] - sums[CURVATURE + 3, j]
        yz = sums[4, j] - sums[CURVATURE + 4, j]
        zz = sums[5, j] - sums[CURVATURE + 5, j]
        full_determinant = _determinant(sums[0, j], sums[1, j], sums[2, j], sums[3, j], sums[4, j], sums[5, j])
        reduced = _determinant(xx, xy, xz, yy, yz, zz)
        downhill = (xx > 0.0) & (xx * yy > xy * xy) & (reduced > _MIN_DETERMINANT_RATIO * full_determinant)
        sums[0, j] = xx if downhill else sums[0, j]
        sums[1, j] = xy if downhill else sums[1, j]
        sums[2, j] = xz if downhill else sums[2, j]
        sums[3, j] = yy if downhill else sums[3, j]
        sums[4, j] = yz if downhill else sums[4, j]
        sums[5, j] = zz if downhill else sums[5, j]


@inline
def _determinant(xx, xy, xz, yy, yz, zz):
    """Return the determinant of a symmetric 3x3 matrix."""
    return xx * (yy * zz - yz * yz) - xy * (xy * zz - xz * yz) + xz * (xy * yz - xz * yy)


@inline
def refine(workspace, thorough, full, none):
    """Refine the points of all lanes with status ACTIVE.

    Args:
        workspace: a Workspace.
        thorough: if True, robust points, first with wider limits and then with the given ones; if False, points of all
            views, abandoned where the views cannot agree.
        full: a view within this many squared sigmas has full weight.
        none: a view beyond this many squared sigmas has weight 0.
    """
    rows, weights, n_used = workspace.rows, workspace.weights, workspace.n_used
    sums, state, lane_status = workspace.sums, workspace.state, workspace.lane_status
    first_iteration = 0 if thorough else _WIDE_ITERATIONS
    last_iteration = _WIDE_ITERATIONS + (MAX_ITERATIONS if thorough else _QUICK_ITERATIONS)
    # A single loop covers all phases, so that its body is compiled once.
    for iteration in range(first_iteration, last_iteration):
        if iteration == _WIDE_ITERATIONS:
            for j in range(BLOCK):
                lane_status[j] = ACTIVE if lane_status[j] == OK else lane_status[j]
                state[COST, j] = math.inf
                state[SCALE, j] = 1.0
        widening = 4.0 if iteration < _WIDE_ITERATIONS else 1.0
        widening = widening if thorough else 1e6
        robust_equations(rows, weights, iteration >= _WIDE_ITERATIONS, state, widening * full, widening * none, sums)
        if not thorough:
            for j in range(BLOCK):
                hopeless = not sums[TOTAL, j] < _HOPELESS * full * n_used[j]
                lane_status[j] = SINGULAR if hopeless & (lane_status[j] == ACTIVE) else lane_status[j]
        n_active = take_step(sums, state, lane_status)
        if (n_active == 0) & (iteration >= _WIDE_ITERATIONS):
            break
    # Weights that change with the point can slow down or stall the last steps. Every accepted step lowered the cost, so
    # a lane with a finite cost has a valid point.
    for j in range(BLOCK):
        unfinished = (lane_status[j] == ACTIVE) | (lane_status[j] == BEHIND)
        lane_status[j] = OK if thorough & unfinished & (state[COST, j] < math.inf) else lane_status[j]


@inline
def accept(workspace, none):
    """Select the inlier views of each lane; a view at or beyond ``none`` squared sigmas is an outlier."""
    rows, weights, state = workspace.rows, workspace.weights, workspace.state
    accepted, n_agreeing = workspace.accepted, workspace.n_agreeing
    for j in range(BLOCK):
        n_agreeing[j] = 0
    for v in range(weights.shape[0]):
        for j in range(BLOCK):
            w = weights[v, j]
            depth, r, s = residual(rows, v, j, state[X, j], state[X + 1, j], state[X + 2, j])
            inlier = (w * (r * r + s * s) < none) & (depth > 0.0) & (w > 0.0)
            accepted[v, j] = w if inlier else 0.0
            n_agreeing[j] += 1 if inlier else 0
