"""Branch and bound over the states of a few views: either no two points cost less than those found, or here they are.

Given which observations a point rests on, it costs what these do, and more with each. So views are taken one by one,
each as labelled, swapped, in part or not at all, and a branch is left as soon as what it has costs as much as the
couple found. A least-squares cost bounds the bounded one from below and, with every row divided by its depth near the
points, is a quadratic: sums of ten numbers and one 3x3 solve. One lane at a time. See docs/methods.md, "Pairs".
"""

import math
from collections import namedtuple

import numpy as np

from posefuse.kernels.cameras.observation_rows import residual
from posefuse.kernels.cameras.points import add_view, clear_sums, solve_symmetric
from posefuse.kernels.jit import inline, kernel, step
from posefuse.kernels.left_right.search import bounded

MOST_VIEWS = 6
"""With more views the search is left as it is."""

ProofRoom = namedtuple("ProofRoom", "quadratic branch picks points centre")
"""Of one lane:

quadratic: shape (3 MOST_VIEWS, 15): of the left and the right observation of each view, and of none, the parts of A
(6), b (3) and c of the squared error x'Ax + 2b'x + c at x from the centre, its depth there (4) in units of that at the
centre, and 0, or inf where there is no observation.
branch: shape (MOST_VIEWS + 1, ROWS): a branch after so many views.
picks: shape (3, MOST_VIEWS), int64: the label each point takes in the branch's views, and these views.
points: shape (2, 4): the cost and the place of both points of a finished branch.
centre: shape (3,), between the points found.
"""

# Of a branch: sums of both quadratics, the least that either point may cost with the left or the right observation of
# the next view or neither, how many observations it has, what those left out cost, which state of the view is next.
_LEAST = 20
_SIZE = 26
_SPENT = 28
_TURN = 29
_ROWS = 30

_DEPTH = 10
_ABSENT = 14
_NEITHER = 2
# Labels of both points: as labelled, swapped, one point has an observation, none.
_STATES = np.array([[0, 1], [1, 0], [0, 2], [1, 2], [2, 0], [2, 1], [2, 2]])

# Costs must be less by this much (squared sigmas): rounding, and points not quite settled.
_LESS = 1e-4
_ROUNDS = 30
_GENEROUS = 2
_SMALL_STEP = 1e-4


@kernel
def make_proof_room():
    """Room for one lane."""
    return ProofRoom(
        quadratic=np.zeros((3 * MOST_VIEWS, 15)),
        branch=np.zeros((MOST_VIEWS + 1, _ROWS)),
        picks=np.zeros((3, MOST_VIEWS), np.int64),
        points=np.zeros((2, 4)),
        centre=np.zeros(3),
    )


@step
def _make_quadratic(rows, weight, v, j, centre, out):
    """An observation's row about a centre, divided by its depth there."""
    depth = rows[v, 11, j]
    g = rows[v, 3, j]
    h = rows[v, 7, j]
    for i in range(3):
        g += rows[v, i, j] * centre[i]
        h += rows[v, 4 + i, j] * centre[i]
        depth += rows[v, 8 + i, j] * centre[i]
    inverse = 1.0 / abs(depth)
    w = weight * inverse * inverse
    part = 0
    for i in range(3):
        out[6 + i] = w * (rows[v, i, j] * g + rows[v, 4 + i, j] * h)
        out[_DEPTH + i] = rows[v, 8 + i, j] * inverse
        for k in range(i, 3):
            out[part] = w * (rows[v, i, j] * rows[v, k, j] + rows[v, 4 + i, j] * rows[v, 4 + k, j])
            part += 1
    out[9] = w * (g * g + h * h)
    out[_DEPTH + 3] = depth * inverse
    out[_ABSENT] = 0.0 if weight > 0.0 else math.inf


@step
def _least_squares(quadratic, picks, branch, depth, side, label):
    """No point has a smaller sum of squares for a branch's observations and one more.

    The quadratic weighs each by its depth squared, in units of that at the centre; divided by the greatest of these at
    its own minimum it is a bound from below.
    """
    q = quadratic[3 * depth + label]
    s = branch[depth, 10 * side : 10 * side + 10]
    b0 = s[6] + q[6]
    b1 = s[7] + q[7]
    b2 = s[8] + q[8]
    solved, x, y, z = solve_symmetric(
        s[0] + q[0], s[1] + q[1], s[2] + q[2], s[3] + q[3], s[4] + q[4], s[5] + q[5], -b0, -b1, -b2
    )
    nearest = 1.0
    farthest = 0.0
    for v in range(depth + 1):
        chosen = label if v == depth else picks[side, v]
        if chosen != _NEITHER:
            p = quadratic[3 * v + chosen]
            there = p[10] * x + p[11] * y + p[12] * z + p[13]
            nearest = min(nearest, there)
            farthest = max(farthest, there)
    value = (s[9] + q[9] + b0 * x + b1 * y + b2 * z) / (farthest * farthest)
    return value if solved and nearest > 0.0 and value > 0.0 else 0.0


@step
def _expand(quadratic, picks, branch, depth, full, none):
    """The least that either point may cost with the next view's observations.

    No observations, each of a square below ``none``, cost less than as many as can be that far off and one of the rest.
    """
    branch[depth, _TURN] = 0.0
    for side in range(2):
        for label in range(2):
            q = quadratic[3 * depth + label]
            least = 0.0
            if branch[depth, _SIZE + side] > 0.0 and q[_ABSENT] == 0.0:
                least = _least_squares(quadratic, picks, branch, depth, side, label)
            whole = math.floor(least / none)
            cost = bounded(least - whole * none, full, 1.0 / (none - full))
            cost += whole * (full + (none - full) * (1.0 / 3.0))
            branch[depth, _LEAST + 3 * side + label] = cost + q[_ABSENT]


@step
def _enter(quadratic, picks, branch, depth, bound, cost):
    """Put the next view into the next of its states; whether a couple that costs less than ``cost`` may come of it."""
    state = int(branch[depth, _TURN])
    branch[depth, _TURN] += 1.0
    here = branch[depth]
    there = branch[depth + 1]
    # Points have no names: the first observation goes to the first point.
    if here[_SIZE] == 0.0 and (state == 1 or state == 4 or state == 5):
        return False
    spent = here[_SPENT]
    for label in range(2):
        unused = _STATES[state, 0] != label and _STATES[state, 1] != label
        spent += bound if unused and quadratic[3 * depth + label, _ABSENT] == 0.0 else 0.0
    there[_SPENT] = spent
    for side in range(2):
        label = _STATES[state, side]
        spent += here[_LEAST + 3 * side + label]
        picks[side, depth] = label
        there[_LEAST + 3 * side + _NEITHER] = here[_LEAST + 3 * side + label]
        there[_SIZE + side] = here[_SIZE + side] + (0.0 if label == _NEITHER else 1.0)
        for i in range(10):
            there[10 * side + i] = here[10 * side + i] + quadratic[3 * depth + label, i]
    return spent < cost - _LESS


@step
def _refine(rows, weights, picks, n, side, j, full, none, sums, point):
    """Cost and place of one point of a branch, by reweighted Gauss-Newton from a place."""
    for turn in range(_ROUNDS):
        wide = 4.0 if turn < _GENEROUS else 1.0
        nothing = wide * none
        span = 1.0 / (nothing - wide * full)
        clear_sums(sums)
        point[0] = 0.0
        for i in range(n):
            label = picks[side, i]
            if label == _NEITHER:
                continue
            v = picks[2, i]
            depth, r, s = residual(rows[label], v, j, point[1], point[2], point[3])
            squared = weights[label, v, j] * (r * r + s * s)
            squared = squared if squared < nothing and depth > 0.0 else nothing
            fall = 1.0 - max(squared - wide * full, 0.0) * span
            point[0] += bounded(squared, wide * full, span)
            add_view(rows[label], v, j, depth, r, s, weights[label, v, j] * fall * fall, sums)
        gx = sums[6, j]
        gy = sums[7, j]
        gz = sums[8, j]
        solved, sx, sy, sz = solve_symmetric(
            sums[0, j], sums[1, j], sums[2, j], sums[3, j], sums[4, j], sums[5, j], gx, gy, gz
        )
        if not solved or (turn >= _GENEROUS and gx * sx + gy * sy + gz * sz < _SMALL_STEP):
            return
        point[1] -= sx
        point[2] -= sy
        point[3] -= sz


@step
def _finish(rows, weights, room, n, j, full, none, sums):
    """What a branch costs to which nothing is left to add."""
    branch, centre = room.branch[n], room.centre
    if max(branch[_SIZE], branch[_SIZE + 1]) < 2.0:
        return math.inf
    total = branch[_SPENT]
    for side in range(2):
        point = room.points[side]
        s = branch[10 * side : 10 * side + 10]
        # A lone observation does not fix its point.
        point[0], point[1], point[2], point[3] = 0.0, math.nan, math.nan, math.nan
        if branch[_SIZE + side] > 1.0:
            _, x, y, z = solve_symmetric(s[0], s[1], s[2], s[3], s[4], s[5], -s[6], -s[7], -s[8])
            point[1], point[2], point[3] = x + centre[0], y + centre[1], z + centre[2]
            _refine(rows, weights, room.picks, n, side, j, full, none, sums, point)
        total += point[0]
    return total


@inline
def _begin(rows, weights, couple, j, room):
    """An empty branch, and the rows of the views that have any observation; how many views."""
    branch = room.branch[0]
    for i in range(_ROWS):
        branch[i] = 0.0
    for i in range(3):
        x, y = couple[i, j], couple[3 + i, j]
        x = x if x == x else y
        y = y if y == y else x
        room.centre[i] = 0.5 * (x + y) if x == x else 0.0
    n = 0
    for v in range(weights.shape[1]):
        if weights[0, v, j] > 0.0 or weights[1, v, j] > 0.0:
            for label in range(2):
                out = room.quadratic[3 * n + label]
                _make_quadratic(rows[label], weights[label, v, j], v, j, room.centre, out)
            room.picks[2, n] = v
            n += 1
    return n


@step
def prove_lane(rows, weights, full, none, couple, cost, j, sums, room):
    """Replace the couple found in lane ``j``, of few views, by one that costs less if there is any.

    Args:
        rows: shape (label, view, 12, BLOCK).
        weights: shape (label, view, BLOCK); 0 is not there.
        full, none: see :func:`posefuse.kernels.left_right.search.bounded`, in squared sigma units.
        couple: shape (COUPLE_ROWS, BLOCK), in and out: two points; NaN then if none cost less.
        cost: what it costs, observations that are not there costing nothing.
        j: the lane.
        sums: shape (SUM_ROWS, BLOCK), scratch.
        room: a ProofRoom, scratch.
    """
    quadratic, branch, picks = room.quadratic, room.branch, room.picks
    bound = full + (none - full) * (1.0 / 3.0)
    n = _begin(rows, weights, couple, j, room)
    for i in range(6):
        couple[i, j] = math.nan
    depth = 0
    _expand(quadratic, picks, branch, depth, full, none)
    while depth >= 0:
        if branch[depth, _TURN] == _STATES.shape[0]:
            depth -= 1
        elif _enter(quadratic, picks, branch, depth, bound, cost):
            if depth + 1 < n:
                depth += 1
                _expand(quadratic, picks, branch, depth, full, none)
                continue
            total = _finish(rows, weights, room, n, j, full, none, sums)
            if total < cost - _LESS:
                cost = total
                # Where there is one point only, it is the first.
                first = 0 if room.points[0, 1] == room.points[0, 1] else 1
                for i in range(3):
                    couple[i, j] = room.points[first, 1 + i]
                    couple[3 + i, j] = room.points[1 - first, 1 + i]
