"""Joint refinement of the two points of a candidate: reweighted Gauss-Newton with every view in its best state."""

import math

from posefuse.kernels.cameras.observation_rows import BLOCK, residual
from posefuse.kernels.cameras.points import add_view, clear_sums
from posefuse.kernels.jit import inline
from posefuse.kernels.left_right.search import bounded
from posefuse.kernels.linear_algebra.symmetric_3x3 import solve_symmetric

# Rows of the array of a candidate, which has one column per lane.
CANDIDATE_COST = 6
LAST_STEP = 7
N_SUPPORT = 8
SPARE_RAY = 10
CANDIDATE_ROWS = 11

_WIDE_ITERATIONS = 2
# Minimum number of rays that determine a point.
_MIN_RAYS = 2.0
# A step of a hundredth of the standard error of the point.
_SMALL_STEP = 1e-4


@inline
def squared_residual(rows, weights, v, j, candidate, row, none):
    """Return the squared residual, in sigmas, of an observation for the point at ``row`` of a candidate.

    The result is at most ``none``, also if the point lies behind the camera or the observation is missing.
    """
    depth, r, s = residual(rows, v, j, candidate[row, j], candidate[row + 1, j], candidate[row + 2, j])
    squared = weights[v, j] * (r * r + s * s)
    near = (squared < none) & (depth > 0.0) & (weights[v, j] > 0.0)
    return squared if near else none


@inline
def _weight(squared, full, inverse_span):
    """Return the derivative of the bounded cost."""
    over = squared - full
    falloff = 1.0 - (over if over > 0.0 else 0.0) * inverse_span
    return falloff * falloff


@inline
def _weigh_view(rows, weights, v, candidate, full, none, point_weights):
    """Put a view into its cheapest state; write the weights of its observations for each point."""
    inverse_span = 1.0 / (none - full)
    bound = full + (none - full) * (1.0 / 3.0)
    left, right = rows[0], rows[1]
    weights_left, weights_right = weights[0], weights[1]
    for j in range(BLOCK):
        e0l = squared_residual(left, weights_left, v, j, candidate, 0, none)
        e0r = squared_residual(right, weights_right, v, j, candidate, 0, none)
        e1l = squared_residual(left, weights_left, v, j, candidate, 3, none)
        e1r = squared_residual(right, weights_right, v, j, candidate, 3, none)
        unswapped_cost = bounded(e0l, full, inverse_span) + bounded(e1r, full, inverse_span)
        swapped_cost = bounded(e0r, full, inverse_span) + bounded(e1l, full, inverse_span)
        min_cost = unswapped_cost if unswapped_cost <= swapped_cost else swapped_cost
        candidate[CANDIDATE_COST, j] += min_cost
        # With a single point, a view has a spare observation if it has two, or one that does not fit the point.
        present = (weights_left[v, j] > 0.0) | (weights_right[v, j] > 0.0)
        both = (weights_left[v, j] > 0.0) & (weights_right[v, j] > 0.0)
        spare = both | (present & (min_cost > 1.999 * bound))
        candidate[SPARE_RAY, j] = bound if spare else candidate[SPARE_RAY, j]
        as_labelled = 1.0 if unswapped_cost <= swapped_cost else 0.0
        swapped = 1.0 - as_labelled
        candidate[N_SUPPORT, j] += 1.0 if (e0l if unswapped_cost <= swapped_cost else e0r) < none else 0.0
        candidate[N_SUPPORT + 1, j] += 1.0 if (e1r if unswapped_cost <= swapped_cost else e1l) < none else 0.0
        point_weights[0, j] = as_labelled * weights_left[v, j] * _weight(e0l, full, inverse_span)
        point_weights[1, j] = swapped * weights_right[v, j] * _weight(e0r, full, inverse_span)
        point_weights[2, j] = swapped * weights_left[v, j] * _weight(e1l, full, inverse_span)
        point_weights[3, j] = as_labelled * weights_right[v, j] * _weight(e1r, full, inverse_span)


@inline
def _add_views(workspace, candidate, full, none):
    """Compute the normal equations of both points and the cost of the candidate, every view in its best state."""
    rows, weights = workspace.rows, workspace.weights
    point_weights, sums = workspace.point_weights, workspace.sums
    clear_sums(sums[0])
    clear_sums(sums[1])
    for v in range(weights.shape[1]):
        _weigh_view(rows, weights, v, candidate, full, none, point_weights)
        for k in range(4):
            side = k >> 1
            k_rows, k_sums = rows[k & 1], sums[side]
            for j in range(BLOCK):
                x, y, z = candidate[3 * side, j], candidate[3 * side + 1, j], candidate[3 * side + 2, j]
                depth, r, s = residual(k_rows, v, j, x, y, z)
                add_view(k_rows, v, j, depth, r, s, point_weights[k, j], k_sums)
    # One spare ray may belong to a second point, which a single ray does not determine.
    for j in range(BLOCK):
        incomplete = (candidate[0, j] != candidate[0, j]) | (candidate[3, j] != candidate[3, j])
        candidate[CANDIDATE_COST, j] -= candidate[SPARE_RAY, j] if incomplete else 0.0


@inline
def _step_point(sums, candidate, row):
    """Take a Gauss-Newton step of one point of every lane; a point without any ray stays where it is."""
    for j in range(BLOCK):
        gx = sums[6, j]
        gy = sums[7, j]
        gz = sums[8, j]
        solved, sx, sy, sz = solve_symmetric(
            sums[0, j], sums[1, j], sums[2, j], sums[3, j], sums[4, j], sums[5, j], gx, gy, gz
        )
        candidate[row, j] -= sx if solved else 0.0
        candidate[row + 1, j] -= sy if solved else 0.0
        candidate[row + 2, j] -= sz if solved else 0.0
        candidate[LAST_STEP, j] = max(candidate[LAST_STEP, j], gx * sx + gy * sy + gz * sz if solved else 0.0)


@inline
def _drop_unsupported(candidate, side):
    """Drop points that too few rays support; their observations become unexplained, so iterations continue."""
    for j in range(BLOCK):
        present = candidate[3 * side, j] == candidate[3 * side, j]
        drop = present & (candidate[N_SUPPORT + side, j] < _MIN_RAYS)
        for i in range(3 * side, 3 * side + 3):
            candidate[i, j] = math.nan if drop else candidate[i, j]
        candidate[LAST_STEP, j] = math.inf if drop else candidate[LAST_STEP, j]


@inline
def refine_candidate(workspace, candidate, first_iteration, last_iteration, full, none):
    """Refine candidates over all views, starting at their current points.

    A converged lane stays fixed while others continue, so the result of a lane does not depend on its neighbors.

    Args:
        workspace: a Workspace.
        candidate: shape (CANDIDATE_ROWS, BLOCK): two points, their cost, the size of the last step (squared standard
            errors), the number of rays that support each, and the saving of a spare ray; NaN for a missing point.
        first_iteration: 0 to start with two iterations with wider limits, 2 to skip them.
        last_iteration: number of the iteration to stop at.
        full: an observation within this many squared sigmas of its point has full weight.
        none: an observation beyond this many squared sigmas has weight 0.
    """
    trial, sums = workspace.trial, workspace.sums
    for j in range(BLOCK):
        candidate[CANDIDATE_COST, j] = math.inf
        candidate[LAST_STEP, j] = math.inf
    for iteration in range(first_iteration, last_iteration):
        widening = 4.0 if iteration < _WIDE_ITERATIONS else 1.0
        for i in range(CANDIDATE_COST):
            for j in range(BLOCK):
                trial[i, j] = candidate[i, j]
        for i in range(CANDIDATE_COST, CANDIDATE_ROWS):
            for j in range(BLOCK):
                trial[i, j] = 0.0
        _add_views(workspace, trial, widening * full, widening * none)
        for side in range(2):
            _step_point(sums[side], trial, 3 * side)
            if iteration >= _WIDE_ITERATIONS:
                _drop_unsupported(trial, side)
        n_moving = 0
        for j in range(BLOCK):
            converged = candidate[LAST_STEP, j] < _SMALL_STEP
            for i in range(CANDIDATE_ROWS):
                candidate[i, j] = candidate[i, j] if converged else trial[i, j]
            candidate[LAST_STEP, j] = math.inf if iteration < _WIDE_ITERATIONS else candidate[LAST_STEP, j]
            n_moving += 0 if converged else 1
        if n_moving == 0:
            break
