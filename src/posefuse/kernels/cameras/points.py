"""Points from observation rows: linear start, maximum-likelihood refinement, covariance.

All functions use the rows of :func:`posefuse.kernels.cameras.observation_rows.rows_block`: per view ``g0, g1, c`` with
residual ``(g0.X, g1.X) / c.X`` in true pixels and depth ``c.X``. The weight of a view is ``1 / sigma^2`` in 1/px^2; a
view of weight 0 is ignored. Symmetric 3x3 matrices are stored as six numbers: xx, xy, xz, yy, yz, zz.

Points are processed in blocks of ``BLOCK`` lanes. The lane is the last axis of every array, so that loops over lanes
become vector instructions.
"""

import math

from posefuse.kernels import status_codes
from posefuse.kernels.cameras.observation_rows import BLOCK, residual
from posefuse.kernels.jit import inline
from posefuse.kernels.linear_algebra.symmetric_3x3 import invert_symmetric, solve_symmetric

OK = 0


SINGULAR = 1
"""The rays do not determine a point: fewer than two, parallel, or from one camera center."""


BEHIND = 2
"""The point lies behind a camera that observes it."""


NO_CONVERGENCE = 3


ACTIVE = 4
"""The lane has not converged and needs another step."""


# Rows of the state array, which has one column per lane.
X = 0


COST = 3
"""Sum of squared residuals in squared sigmas."""


SCALE = 4
"""Fraction of the last step that was taken; halved after a failed step."""


STEP = 5


INFORMATION = 8
"""Six numbers: the inverse covariance."""


STATE_ROWS = 14


# Rows of the array of sums over views.
_GRADIENT = 6


TOTAL = 9
"""The cost."""


DEPTH = 10
"""The smallest depth over the used views."""


SUM_ROWS = 11


MAX_ITERATIONS = 30


# Stop after a step of a hundredth of the standard error of the point. Each step reduces the error more than tenfold, so
# the remaining error is far smaller.
_SMALL_STEP = 1e-4


# Also stop once the step is below the rounding error of the coordinates.
_SMALLEST_STEP_SQUARED = 1e-20


# The geometry is weak if the standard deviation exceeds the first fraction of the distance from a camera, and
# degenerate beyond the second: the rays are then parallel within the noise.
_WEAK_SHARE = 0.1


_DEGENERATE_SHARE = 0.25


@inline
def clear_sums(sums):
    """Reset the sums over views."""
    for k in range(SUM_ROWS):
        for j in range(BLOCK):
            sums[k, j] = 0.0
    for j in range(BLOCK):
        sums[DEPTH, j] = math.inf


@inline
def _add_equations(a0, a1, a2, b0, b1, b2, r, s, w, j, sums):
    """Add two residuals of weight ``w``, with derivatives a and b, to the normal equations of a lane."""
    wa0 = w * a0
    wa1 = w * a1
    wa2 = w * a2
    wb0 = w * b0
    wb1 = w * b1
    wb2 = w * b2
    sums[0, j] += wa0 * a0 + wb0 * b0
    sums[1, j] += wa0 * a1 + wb0 * b1
    sums[2, j] += wa0 * a2 + wb0 * b2
    sums[3, j] += wa1 * a1 + wb1 * b1
    sums[4, j] += wa1 * a2 + wb1 * b2
    sums[5, j] += wa2 * a2 + wb2 * b2
    sums[6, j] += wa0 * r + wb0 * s
    sums[7, j] += wa1 * r + wb1 * s
    sums[8, j] += wa2 * r + wb2 * s


@inline
def linear_start(rows, weights, sums, state, lane_status):
    """Initialize active lanes at the minimum of the depth-weighted (algebraic) residuals."""
    clear_sums(sums)
    for v in range(weights.shape[0]):
        for j in range(BLOCK):
            _add_equations(
                rows[v, 0, j],
                rows[v, 1, j],
                rows[v, 2, j],
                rows[v, 4, j],
                rows[v, 5, j],
                rows[v, 6, j],
                rows[v, 3, j],
                rows[v, 7, j],
                weights[v, j],
                j,
                sums,
            )
    for j in range(BLOCK):
        solved, x, y, z = solve_symmetric(
            sums[0, j], sums[1, j], sums[2, j], sums[3, j], sums[4, j], sums[5, j], sums[6, j], sums[7, j], sums[8, j]
        )
        state[X, j] = -x
        state[X + 1, j] = -y
        state[X + 2, j] = -z
        state[COST, j] = math.inf
        state[SCALE, j] = 1.0
        lane_status[j] = SINGULAR if (lane_status[j] == ACTIVE) & (not solved) else lane_status[j]


@inline
def add_view(rows, v, j, depth, r, s, w, sums):
    """Add a view of weight ``w`` (1/px^2) to the sums of its lane, except for the cost."""
    inverse = 1.0 / depth
    c0 = inverse * rows[v, 8, j]
    c1 = inverse * rows[v, 9, j]
    c2 = inverse * rows[v, 10, j]
    _add_equations(
        inverse * rows[v, 0, j] - r * c0,
        inverse * rows[v, 1, j] - r * c1,
        inverse * rows[v, 2, j] - r * c2,
        inverse * rows[v, 4, j] - s * c0,
        inverse * rows[v, 5, j] - s * c1,
        inverse * rows[v, 6, j] - s * c2,
        r,
        s,
        w,
        j,
        sums,
    )
    sums[DEPTH, j] = min(sums[DEPTH, j], depth if w > 0.0 else math.inf)


@inline
def normal_equations(rows, weights, state, sums):
    """Compute the Gauss-Newton normal equations of the weighted reprojection error at the point of each lane.

    ``sums`` receives the information matrix, the gradient, the cost, and the smallest depth over used views.
    """
    clear_sums(sums)
    for v in range(weights.shape[0]):
        for j in range(BLOCK):
            depth, r, s = residual(rows, v, j, state[X, j], state[X + 1, j], state[X + 2, j])
            add_view(rows, v, j, depth, r, s, weights[v, j], sums)
            sums[TOTAL, j] += weights[v, j] * (r * r + s * s)


@inline
def take_step(sums, state, lane_status):
    """Take one damped Gauss-Newton step in every active lane; ``sums`` receives the steps in place of the gradients.

    If a step moved the point behind a used view or raised the cost, half of it is taken instead. The code has no
    branches, because they would prevent vector instructions.

    Returns:
        Number of lanes that are still active.
    """
    for j in range(BLOCK):
        gx = sums[_GRADIENT, j]
        gy = sums[_GRADIENT + 1, j]
        gz = sums[_GRADIENT + 2, j]
        solved, sx, sy, sz = solve_symmetric(
            sums[0, j], sums[1, j], sums[2, j], sums[3, j], sums[4, j], sums[5, j], gx, gy, gz
        )
        sums[_GRADIENT, j] = sx
        sums[_GRADIENT + 1, j] = sy
        sums[_GRADIENT + 2, j] = sz
        # The product of step and gradient is the squared step in units of the point's standard error.
        step_squared = sx * sx + sy * sy + sz * sz
        depth = sums[DEPTH, j]
        small = (gx * sx + gy * sy + gz * sz < _SMALL_STEP) | (step_squared < _SMALLEST_STEP_SQUARED * depth * depth)
        cost = sums[TOTAL, j]
        best = state[COST, j]
        better = (depth > 0.0) & (cost <= best * (1.0 + 1e-12))
        scale = 1.0 if better else 0.5 * state[SCALE, j]
        hopeless = (best == math.inf) | (scale < 1e-9)
        failed = hopeless if not better else not solved
        active = lane_status[j] == ACTIVE
        proceed = active & (not failed)
        advance = proceed & better
        for k in range(3):
            step = sums[_GRADIENT + k, j]
            state[X + k, j] -= (step if better else -scale * state[STEP + k, j]) if proceed else 0.0
            state[STEP + k, j] = step if advance else state[STEP + k, j]
        state[SCALE, j] = scale if proceed else state[SCALE, j]
        state[COST, j] = cost if advance else best
        for k in range(6):
            state[INFORMATION + k, j] = sums[k, j] if advance else state[INFORMATION + k, j]
        code = BEHIND if not better else SINGULAR
        code = code if failed else (OK if better & small else ACTIVE)
        lane_status[j] = code if active else lane_status[j]
    active_lanes = 0
    for j in range(BLOCK):
        active_lanes += 1 if lane_status[j] == ACTIVE else 0
    return active_lanes


@inline
def solve_block(rows, weights, sums, state, lane_status):
    """Compute the maximum-likelihood points of a block.

    Args:
        rows: shape (view, 12, BLOCK).
        weights: shape (view, BLOCK).
        sums: shape (SUM_ROWS, BLOCK), scratch.
        state: shape (STATE_ROWS, BLOCK), written: position, cost, information matrix.
        lane_status: shape (BLOCK,), in and out: lanes with status ACTIVE are solved, the others stay unchanged.
    """
    linear_start(rows, weights, sums, state, lane_status)
    for _ in range(MAX_ITERATIONS):
        normal_equations(rows, weights, state, sums)
        if take_step(sums, state, lane_status) == 0:
            return
    for j in range(BLOCK):
        lane_status[j] = NO_CONVERGENCE if lane_status[j] == ACTIVE else lane_status[j]


@inline
def open_lanes(weights, min_views, lane_status, n_used):
    """Count the used views of each lane; lanes with enough views become ACTIVE, the others OK."""
    for j in range(BLOCK):
        n_used[j] = 0
    for v in range(weights.shape[0]):
        for j in range(BLOCK):
            n_used[j] += 1 if weights[v, j] > 0.0 else 0
    for j in range(BLOCK):
        lane_status[j] = ACTIVE if n_used[j] >= min_views else OK


@inline
def judge_geometry(state, sums, status):
    """Convert the information of a block to covariances and flag points whose depth the rays do not determine.

    ``sums``, of the last step, receives the covariances in its first six rows.
    """
    for j in range(BLOCK):
        depth = sums[DEPTH, j]
        regular, xx, xy, xz, yy, yz, zz = invert_symmetric(
            state[INFORMATION, j],
            state[INFORMATION + 1, j],
            state[INFORMATION + 2, j],
            state[INFORMATION + 3, j],
            state[INFORMATION + 4, j],
            state[INFORMATION + 5, j],
        )
        sums[0, j] = xx
        sums[1, j] = xy
        sums[2, j] = xz
        sums[3, j] = yy
        sums[4, j] = yz
        sums[5, j] = zz
        spread = xx + yy + zz
        code = status[j]
        weak = spread > _WEAK_SHARE * _WEAK_SHARE * depth * depth
        lost = (spread > _DEGENERATE_SHARE * _DEGENERATE_SHARE * depth * depth) | (not regular)
        judged = (
            status_codes.POINT_DEGENERATE if lost else (max(code, status_codes.POINT_WEAK_GEOMETRY) if weak else code)
        )
        status[j] = judged if code < status_codes.POINT_MISSING else code


@inline
def store_points(state, covariances, status, lane_indices, points, covariance, out_status):
    """Write positions and covariances of a block; NaN where the status says missing."""
    for j in range(BLOCK):
        n = lane_indices[0, j]
        k = lane_indices[1, j]
        if n < 0:
            continue
        out_status[n, k] = status[j]
        if status[j] >= status_codes.POINT_MISSING:
            for i in range(3):
                points[n, k, i] = math.nan
            for i in range(6):
                covariance[n, k, i] = math.nan
            continue
        for i in range(3):
            points[n, k, i] = state[X + i, j]
        for i in range(6):
            covariance[n, k, i] = covariances[i, j]
