"""Two points of a block refined together: every view in its best state at every step, reweighted Gauss-Newton."""

import math

from posefuse.kernels.jit import inline, step
from posefuse.kernels.pair_search import bounded
from posefuse.kernels.points import X, solve_symmetric
from posefuse.kernels.rows import BLOCK, residual

# Rows of a couple's array, a column a lane.
COUPLE_COST = 6
MOVED = 7
COUPLE_ROWS = 8

COUPLE_SUMS = 9
_GENEROUS_ROUNDS = 2
# A step of a hundredth of the point's own standard error.
_SMALL_STEP = 1e-4


@inline
def _squared(depth, r, s, w, none):
    """A residual in squared sigma units, at most ``none``; that where the point lies behind or there is none."""
    squared = w * (r * r + s * s)
    near = (squared < none) & (depth > 0.0) & (w > 0.0)
    return squared if near else none


@inline
def squared_residual(rows, weights, v, j, couple, row, none):
    """The residual of an observation from the point that begins at ``row`` of a couple, as :func:`_squared` has it."""
    depth, r, s = residual(rows, v, j, couple[row, j], couple[row + 1, j], couple[row + 2, j])
    return _squared(depth, r, s, weights[v, j], none)


@inline
def _add(g0, g1, g2, h0, h1, h2, c0, c1, c2, depth, r, s, w, sums, j):
    """Add an observation of weight ``w`` to the normal equations of a point."""
    inverse = 1.0 / depth
    a0 = g0 - r * c0
    a1 = g1 - r * c1
    a2 = g2 - r * c2
    b0 = h0 - s * c0
    b1 = h1 - s * c1
    b2 = h2 - s * c2
    w1 = w * inverse
    w2 = w1 * inverse
    sums[0, j] += w2 * (a0 * a0 + b0 * b0)
    sums[1, j] += w2 * (a0 * a1 + b0 * b1)
    sums[2, j] += w2 * (a0 * a2 + b0 * b2)
    sums[3, j] += w2 * (a1 * a1 + b1 * b1)
    sums[4, j] += w2 * (a1 * a2 + b1 * b2)
    sums[5, j] += w2 * (a2 * a2 + b2 * b2)
    sums[6, j] += w1 * (r * a0 + s * b0)
    sums[7, j] += w1 * (r * a1 + s * b1)
    sums[8, j] += w1 * (r * a2 + s * b2)


@inline
def _weight(squared, full, inverse_span):
    fall = 1.0 - min(max((squared - full) * inverse_span, 0.0), 1.0)
    return fall * fall


@inline
def _add_states(rows_left, rows_right, weights_left, weights_right, couple, full, none, first, second):
    """Put every view in the state that costs least, and add what it then says to both points' equations."""
    span = none - full
    inverse_span = 1.0 / span
    for v in range(weights_left.shape[0]):
        for j in range(BLOCK):
            x0, y0, z0 = couple[0, j], couple[1, j], couple[2, j]
            x1, y1, z1 = couple[3, j], couple[4, j], couple[5, j]
            wl = weights_left[v, j]
            wr = weights_right[v, j]
            d0l, r0l, s0l = residual(rows_left, v, j, x0, y0, z0)
            d0r, r0r, s0r = residual(rows_right, v, j, x0, y0, z0)
            d1l, r1l, s1l = residual(rows_left, v, j, x1, y1, z1)
            d1r, r1r, s1r = residual(rows_right, v, j, x1, y1, z1)
            e0l = _squared(d0l, r0l, s0l, wl, none)
            e0r = _squared(d0r, r0r, s0r, wr, none)
            e1l = _squared(d1l, r1l, s1l, wl, none)
            e1r = _squared(d1r, r1r, s1r, wr, none)
            straight = bounded(e0l, full, span, inverse_span) + bounded(e1r, full, span, inverse_span)
            crossed = bounded(e0r, full, span, inverse_span) + bounded(e1l, full, span, inverse_span)
            as_labelled = straight <= crossed
            couple[COUPLE_COST, j] += min(straight, crossed)
            w0 = wl * _weight(e0l, full, inverse_span) if as_labelled else wr * _weight(e0r, full, inverse_span)
            w1 = wr * _weight(e1r, full, inverse_span) if as_labelled else wl * _weight(e1l, full, inverse_span)
            g0 = rows_left[v, 0, j]
            g1 = rows_left[v, 1, j]
            g2 = rows_left[v, 2, j]
            h0 = rows_left[v, 4, j]
            h1 = rows_left[v, 5, j]
            h2 = rows_left[v, 6, j]
            c0 = rows_left[v, 8, j]
            c1 = rows_left[v, 9, j]
            c2 = rows_left[v, 10, j]
            p0 = rows_right[v, 0, j]
            p1 = rows_right[v, 1, j]
            p2 = rows_right[v, 2, j]
            q0 = rows_right[v, 4, j]
            q1 = rows_right[v, 5, j]
            q2 = rows_right[v, 6, j]
            k0 = rows_right[v, 8, j]
            k1 = rows_right[v, 9, j]
            k2 = rows_right[v, 10, j]
            _add(
                g0 if as_labelled else p0, g1 if as_labelled else p1, g2 if as_labelled else p2,
                h0 if as_labelled else q0, h1 if as_labelled else q1, h2 if as_labelled else q2,
                c0 if as_labelled else k0, c1 if as_labelled else k1, c2 if as_labelled else k2,
                d0l if as_labelled else d0r, r0l if as_labelled else r0r, s0l if as_labelled else s0r, w0, first, j,
            )  # fmt: skip
            _add(
                p0 if as_labelled else g0, p1 if as_labelled else g1, p2 if as_labelled else g2,
                q0 if as_labelled else h0, q1 if as_labelled else h1, q2 if as_labelled else h2,
                k0 if as_labelled else c0, k1 if as_labelled else c1, k2 if as_labelled else c2,
                d1r if as_labelled else d1l, r1r if as_labelled else r1l, s1r if as_labelled else s1l, w1, second, j,
            )  # fmt: skip


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


@step
def settle(rows, weights, begin, end, full, none, couple, trial, sums):
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
            step moved them; NaN in the place of a point that is not there.
        trial: shape (COUPLE_ROWS, BLOCK), scratch.
        sums: shape (side, COUPLE_SUMS or more, BLOCK), scratch.
    """
    first = sums[0]
    second = sums[1]
    for j in range(BLOCK):
        couple[COUPLE_COST, j] = math.inf
        couple[MOVED, j] = math.inf
    for turn in range(begin, end):
        wide = 4.0 if turn < _GENEROUS_ROUNDS else 1.0
        for i in range(COUPLE_SUMS):
            for j in range(BLOCK):
                first[i, j] = 0.0
                second[i, j] = 0.0
        for i in range(COUPLE_COST):
            for j in range(BLOCK):
                trial[i, j] = couple[i, j]
        for j in range(BLOCK):
            trial[COUPLE_COST, j] = 0.0
            trial[MOVED, j] = 0.0
        _add_states(rows[0], rows[1], weights[0], weights[1], trial, wide * full, wide * none, first, second)
        _step_point(first, trial, X)
        _step_point(second, trial, X + 3)
        going = 0
        for j in range(BLOCK):
            still = couple[MOVED, j] < _SMALL_STEP
            for i in range(COUPLE_ROWS):
                couple[i, j] = couple[i, j] if still else trial[i, j]
            couple[MOVED, j] = math.inf if turn < _GENEROUS_ROUNDS else couple[MOVED, j]
            going += 0 if still else 1
        if going == 0:
            break
