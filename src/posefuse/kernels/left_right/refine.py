"""Two points of a block refined together: every view in its best state at every step, reweighted Gauss-Newton."""

import math

from posefuse.kernels.cameras.observation_rows import BLOCK, residual
from posefuse.kernels.cameras.points import add_view, clear_sums, solve_symmetric
from posefuse.kernels.jit import inline
from posefuse.kernels.left_right.search import bounded

# Rows of a couple's array, a column a lane.
COUPLE_COST = 6
MOVED = 7
HELD = 8
LONE = 10
COUPLE_ROWS = 11

_GENEROUS_ROUNDS = 2
# A point needs rays enough to fix it.
_FEWEST_RAYS = 2.0
# A step of a hundredth of the point's own standard error.
_SMALL_STEP = 1e-4


@inline
def squared_residual(rows, weights, v, j, couple, row, none):
    """How far an observation is from the point that begins at ``row`` of a couple, in squared sigma units.

    At most ``none``; that too where the point lies behind the camera or there is no observation.
    """
    depth, r, s = residual(rows, v, j, couple[row, j], couple[row + 1, j], couple[row + 2, j])
    squared = weights[v, j] * (r * r + s * s)
    near = (squared < none) & (depth > 0.0) & (weights[v, j] > 0.0)
    return squared if near else none


@inline
def _weight(squared, full, inverse_span):
    """The derivative of the bounded cost."""
    over = squared - full
    fall = 1.0 - (over if over > 0.0 else 0.0) * inverse_span
    return fall * fall


@inline
def _put_into_states(rows, weights, v, couple, full, none, shares):
    """Put a view into the state that costs least; the weights its observations then have for each point."""
    inverse_span = 1.0 / (none - full)
    bound = full + (none - full) * (1.0 / 3.0)
    left, right = rows[0], rows[1]
    weights_left, weights_right = weights[0], weights[1]
    for j in range(BLOCK):
        e0l = squared_residual(left, weights_left, v, j, couple, 0, none)
        e0r = squared_residual(right, weights_right, v, j, couple, 0, none)
        e1l = squared_residual(left, weights_left, v, j, couple, 3, none)
        e1r = squared_residual(right, weights_right, v, j, couple, 3, none)
        straight = bounded(e0l, full, inverse_span) + bounded(e1r, full, inverse_span)
        crossed = bounded(e0r, full, inverse_span) + bounded(e1l, full, inverse_span)
        least = straight if straight <= crossed else crossed
        couple[COUPLE_COST, j] += least
        # With one point only, an observation is left over where there are two, or one that is not that point's.
        there = (weights_left[v, j] > 0.0) | (weights_right[v, j] > 0.0)
        both = (weights_left[v, j] > 0.0) & (weights_right[v, j] > 0.0)
        left_over = both | (there & (least > 1.999 * bound))
        couple[LONE, j] = bound if left_over else couple[LONE, j]
        as_labelled = 1.0 if straight <= crossed else 0.0
        swapped = 1.0 - as_labelled
        couple[HELD, j] += 1.0 if (e0l if straight <= crossed else e0r) < none else 0.0
        couple[HELD + 1, j] += 1.0 if (e1r if straight <= crossed else e1l) < none else 0.0
        shares[0, j] = as_labelled * weights_left[v, j] * _weight(e0l, full, inverse_span)
        shares[1, j] = swapped * weights_right[v, j] * _weight(e0r, full, inverse_span)
        shares[2, j] = swapped * weights_left[v, j] * _weight(e1l, full, inverse_span)
        shares[3, j] = as_labelled * weights_right[v, j] * _weight(e1r, full, inverse_span)


@inline
def _add_views(rows, weights, couple, full, none, shares, sums):
    """Both points' normal equations, every view in its best state, and the couple's cost."""
    clear_sums(sums[0])
    clear_sums(sums[1])
    for v in range(weights.shape[1]):
        _put_into_states(rows, weights, v, couple, full, none, shares)
        for part in range(4):
            side = part >> 1
            part_rows, part_sums = rows[part & 1], sums[side]
            for j in range(BLOCK):
                x, y, z = couple[3 * side, j], couple[3 * side + 1, j], couple[3 * side + 2, j]
                depth, r, s = residual(part_rows, v, j, x, y, z)
                add_view(part_rows, v, j, depth, r, s, shares[part, j], part_sums)
    # One ray that is left over may be that of a point which it does not fix.
    for j in range(BLOCK):
        lacking = (couple[0, j] != couple[0, j]) | (couple[3, j] != couple[3, j])
        couple[COUPLE_COST, j] -= couple[LONE, j] if lacking else 0.0


@inline
def _step_point(sums, couple, row):
    """A Gauss-Newton step of one point of every lane; a point that no ray holds stays where it is."""
    for j in range(BLOCK):
        gx = sums[6, j]
        gy = sums[7, j]
        gz = sums[8, j]
        solved, sx, sy, sz = solve_symmetric(
            sums[0, j], sums[1, j], sums[2, j], sums[3, j], sums[4, j], sums[5, j], gx, gy, gz
        )
        couple[row, j] -= sx if solved else 0.0
        couple[row + 1, j] -= sy if solved else 0.0
        couple[row + 2, j] -= sz if solved else 0.0
        couple[MOVED, j] = max(couple[MOVED, j], gx * sx + gy * sy + gz * sz if solved else 0.0)


@inline
def _drop_unheld(couple, side):
    """Leave out points that too few rays hold; what they explained is no longer explained, so all goes on."""
    for j in range(BLOCK):
        there = couple[3 * side, j] == couple[3 * side, j]
        drop = there & (couple[HELD + side, j] < _FEWEST_RAYS)
        for i in range(3 * side, 3 * side + 3):
            couple[i, j] = math.nan if drop else couple[i, j]
        couple[MOVED, j] = math.inf if drop else couple[MOVED, j]


@inline
def settle(rows, weights, begin, end, full, none, couple, trial, shares, sums):
    """Refine couples of points over all views, from where they are.

    A lane that has settled stands still while others go on, so that a couple does not depend on its neighbours.

    Args:
        rows: shape (label, view, 12, BLOCK).
        weights: shape (label, view, BLOCK).
        begin: 0 to begin with two generous rounds, past them not to.
        end: the number of the round to stop at.
        full: an observation within so many squared sigmas of its point counts whole.
        none: beyond so many not at all.
        couple: shape (COUPLE_ROWS, BLOCK): two points, their cost, by how much (in squared standard errors) the last
            step moved them, how many rays hold each, and what a ray left over saves; NaN in the place of a point that
            is not there.
        trial: shape (COUPLE_ROWS, BLOCK), scratch.
        shares: shape (4, BLOCK), scratch.
        sums: shape (side, SUM_ROWS, BLOCK), scratch.
    """
    for j in range(BLOCK):
        couple[COUPLE_COST, j] = math.inf
        couple[MOVED, j] = math.inf
    for turn in range(begin, end):
        wide = 4.0 if turn < _GENEROUS_ROUNDS else 1.0
        for i in range(COUPLE_COST):
            for j in range(BLOCK):
                trial[i, j] = couple[i, j]
        for i in range(COUPLE_COST, COUPLE_ROWS):
            for j in range(BLOCK):
                trial[i, j] = 0.0
        _add_views(rows, weights, trial, wide * full, wide * none, shares, sums)
        for side in range(2):
            _step_point(sums[side], trial, 3 * side)
            if turn >= _GENEROUS_ROUNDS:
                _drop_unheld(trial, side)
        going = 0
        for j in range(BLOCK):
            still = couple[MOVED, j] < _SMALL_STEP
            for i in range(COUPLE_ROWS):
                couple[i, j] = couple[i, j] if still else trial[i, j]
            couple[MOVED, j] = math.inf if turn < _GENEROUS_ROUNDS else couple[MOVED, j]
            going += 0 if still else 1
        if going == 0:
            break
