"""Branch and bound over the states of a few views: prove that no two points cost less than a candidate, or find them.

The cost of a point grows with each observation that supports it. Views are therefore taken one by one, each as labeled,
swapped, in part or not at all, and a branch ends as soon as its cost reaches that of the candidate. A least-squares
cost bounds the bounded one from below. With every row divided by its depth near the points, it is a quadratic: sums of
ten numbers and one 3x3 solve. One lane at a time. See docs/methods/left_right.md.
"""

import math
from collections import namedtuple

import numpy as np

from posefuse.kernels.cameras.observation_rows import residual
from posefuse.kernels.cameras.points import add_view, clear_sums
from posefuse.kernels.jit import inline, kernel, subroutine
from posefuse.kernels.left_right.search import bounded
from posefuse.kernels.linear_algebra.symmetric_3x3 import solve_symmetric

MAX_VIEWS = 6
"""Maximum number of views; with more, the candidate is left as it is."""

BranchWorkspace = namedtuple("BranchWorkspace", "quadratic branch chosen_labels points center")
"""Scratch arrays of one lane:

quadratic: shape (3 MAX_VIEWS, 15): for the left and the right observation of each view, and for none, the parts of A
(6), b (3) and c of the squared error x'Ax + 2b'x + c at x from the center, its depth there (4) in units of that at the
center, and 0, or inf where there is no observation.
branch: shape (MAX_VIEWS + 1, _ROWS): one branch per number of views taken.
chosen_labels: shape (3, MAX_VIEWS), int64: the label of each point in the views of the branch, and these views.
points: shape (2, 4): cost and position of both points of a finished branch.
center: shape (3,), between the points of the candidate.
"""

# Layout of a branch: sums of both quadratics, lower bounds of either point with the left or the right observation of
# the next view or neither, numbers of observations, cost of the unused ones, and the next state of the view.
_MIN_COST = 20
_N_OBSERVATIONS = 26
_UNUSED_COST = 28
_NEXT_STATE = 29
_ROWS = 30

_DEPTH = 10
_ABSENT = 14
_NEITHER = 2
# Labels of both points: as labeled, swapped, one point has an observation, none.
_STATES = np.array([[0, 1], [1, 0], [0, 2], [1, 2], [2, 0], [2, 1], [2, 2]])

# Minimum improvement of the cost (squared sigmas), because of rounding and incomplete convergence.
_MIN_IMPROVEMENT = 1e-4
_ITERATIONS = 30
_WIDE_ITERATIONS = 2
_SMALL_STEP = 1e-4


@kernel
def make_branch_workspace():
    """Allocate the scratch arrays of one lane."""
    return BranchWorkspace(
        quadratic=np.zeros((3 * MAX_VIEWS, 15)),
        branch=np.zeros((MAX_VIEWS + 1, _ROWS)),
        chosen_labels=np.zeros((3, MAX_VIEWS), np.int64),
        points=np.zeros((2, 4)),
        center=np.zeros(3),
    )


@subroutine
def _make_quadratic(rows, weight, v, j, center, out):
    """Write an observation row about a center, divided by its depth there."""
    depth = rows[v, 11, j]
    g = rows[v, 3, j]
    h = rows[v, 7, j]
    for i in range(3):
        g += rows[v, i, j] * center[i]
        h += rows[v, 4 + i, j] * center[i]
        depth += rows[v, 8 + i, j] * center[i]
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


@subroutine
def _lower_bound(quadratic, chosen_labels, branch, depth, side, label):
    """Return a lower bound of the squared error of any point with the observations of a branch and one more.

    The quadratic weights each observation by its squared depth, in units of that at the center. Divided by the largest
    squared depth at its minimum, it is a lower bound.
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
        chosen = label if v == depth else chosen_labels[side, v]
        if chosen != _NEITHER:
            p = quadratic[3 * v + chosen]
            child = p[10] * x + p[11] * y + p[12] * z + p[13]
            nearest = min(nearest, child)
            farthest = max(farthest, child)
    value = (s[9] + q[9] + b0 * x + b1 * y + b2 * z) / (farthest * farthest)
    return value if solved and nearest > 0.0 and value > 0.0 else 0.0


@subroutine
def _bound_next_view(quadratic, chosen_labels, branch, depth, full, none):
    """Compute the lower bounds of both points with the observations of the next view.

    Observations with squares below ``none`` cost at least as much as the largest possible number of them at that
    distance and one with the remainder.
    """
    branch[depth, _NEXT_STATE] = 0.0
    for side in range(2):
        for label in range(2):
            q = quadratic[3 * depth + label]
            lower_bound = 0.0
            if branch[depth, _N_OBSERVATIONS + side] > 0.0 and q[_ABSENT] == 0.0:
                lower_bound = _lower_bound(quadratic, chosen_labels, branch, depth, side, label)
            n_whole = math.floor(lower_bound / none)
            cost = bounded(lower_bound - n_whole * none, full, 1.0 / (none - full))
            cost += n_whole * (full + (none - full) * (1.0 / 3.0))
            branch[depth, _MIN_COST + 3 * side + label] = cost + q[_ABSENT]


@subroutine
def _enter_state(quadratic, chosen_labels, branch, depth, bound, cost):
    """Put the next view into its next state; return whether a candidate cheaper than ``cost`` may result."""
    state = int(branch[depth, _NEXT_STATE])
    branch[depth, _NEXT_STATE] += 1.0
    parent = branch[depth]
    child = branch[depth + 1]
    # The two points are interchangeable: the first observation goes to the first point.
    if parent[_N_OBSERVATIONS] == 0.0 and (state == 1 or state == 4 or state == 5):
        return False
    unused_cost = parent[_UNUSED_COST]
    for label in range(2):
        unused = _STATES[state, 0] != label and _STATES[state, 1] != label
        unused_cost += bound if unused and quadratic[3 * depth + label, _ABSENT] == 0.0 else 0.0
    child[_UNUSED_COST] = unused_cost
    for side in range(2):
        label = _STATES[state, side]
        unused_cost += parent[_MIN_COST + 3 * side + label]
        chosen_labels[side, depth] = label
        child[_MIN_COST + 3 * side + _NEITHER] = parent[_MIN_COST + 3 * side + label]
        child[_N_OBSERVATIONS + side] = parent[_N_OBSERVATIONS + side] + (0.0 if label == _NEITHER else 1.0)
        for i in range(10):
            child[10 * side + i] = parent[10 * side + i] + quadratic[3 * depth + label, i]
    return unused_cost < cost - _MIN_IMPROVEMENT


@subroutine
def _refine_point(workspace, lane, n, side, j, full, none):
    """Refine one point of a branch by reweighted Gauss-Newton; write its cost and position."""
    rows, weights, sums = workspace.rows, workspace.weights, workspace.sums[0]
    chosen_labels, point = lane.chosen_labels, lane.points[side]
    for iteration in range(_ITERATIONS):
        widening = 4.0 if iteration < _WIDE_ITERATIONS else 1.0
        zero_weight = widening * none
        span = 1.0 / (zero_weight - widening * full)
        clear_sums(sums)
        point[0] = 0.0
        for i in range(n):
            label = chosen_labels[side, i]
            if label == _NEITHER:
                continue
            v = chosen_labels[2, i]
            depth, r, s = residual(rows[label], v, j, point[1], point[2], point[3])
            squared = weights[label, v, j] * (r * r + s * s)
            squared = squared if squared < zero_weight and depth > 0.0 else zero_weight
            falloff = 1.0 - max(squared - widening * full, 0.0) * span
            point[0] += bounded(squared, widening * full, span)
            add_view(rows[label], v, j, depth, r, s, weights[label, v, j] * falloff * falloff, sums)
        gx = sums[6, j]
        gy = sums[7, j]
        gz = sums[8, j]
        solved, sx, sy, sz = solve_symmetric(
            sums[0, j], sums[1, j], sums[2, j], sums[3, j], sums[4, j], sums[5, j], gx, gy, gz
        )
        if not solved or (iteration >= _WIDE_ITERATIONS and gx * sx + gy * sy + gz * sz < _SMALL_STEP):
            return
        point[1] -= sx
        point[2] -= sy
        point[3] -= sz


@subroutine
def _finish_branch(workspace, lane, n, j, full, none):
    """Return the cost of a complete branch."""
    branch, center = lane.branch[n], lane.center
    if max(branch[_N_OBSERVATIONS], branch[_N_OBSERVATIONS + 1]) < 2.0:
        return math.inf
    total = branch[_UNUSED_COST]
    for side in range(2):
        point = lane.points[side]
        s = branch[10 * side : 10 * side + 10]
        # A single observation does not determine its point.
        point[0], point[1], point[2], point[3] = 0.0, math.nan, math.nan, math.nan
        if branch[_N_OBSERVATIONS + side] > 1.0:
            _, x, y, z = solve_symmetric(s[0], s[1], s[2], s[3], s[4], s[5], -s[6], -s[7], -s[8])
            point[1], point[2], point[3] = x + center[0], y + center[1], z + center[2]
            _refine_point(workspace, lane, n, side, j, full, none)
        total += point[0]
    return total


@inline
def _start_root(workspace, lane, candidate, j):
    """Initialize an empty branch and the rows of the views with any observation; return the number of views."""
    rows, weights, branch = workspace.rows, workspace.weights, lane.branch[0]
    for i in range(_ROWS):
        branch[i] = 0.0
    for i in range(3):
        x, y = candidate[i, j], candidate[3 + i, j]
        x = x if x == x else y
        y = y if y == y else x
        lane.center[i] = 0.5 * (x + y) if x == x else 0.0
    n = 0
    for v in range(weights.shape[1]):
        if weights[0, v, j] > 0.0 or weights[1, v, j] > 0.0:
            for label in range(2):
                out = lane.quadratic[3 * n + label]
                _make_quadratic(rows[label], weights[label, v, j], v, j, lane.center, out)
            lane.chosen_labels[2, n] = v
            n += 1
    return n


@subroutine
def improve_lane(workspace, full, none, candidate, cost, j, lane):
    """Replace the candidate of lane ``j``, which has few views, by a cheaper one if there is any.

    Args:
        workspace: a :class:`posefuse.kernels.left_right.workspace.Workspace`; ``sums`` is scratch.
        full, none: see :func:`posefuse.kernels.left_right.search.bounded`, in squared sigmas.
        candidate: shape (CANDIDATE_ROWS, BLOCK), in and out: two points; NaN on output if none are cheaper.
        cost: cost of the candidate without that of missing observations.
        j: the lane.
        lane: a BranchWorkspace, scratch.
    """
    quadratic, branch, chosen_labels = lane.quadratic, lane.branch, lane.chosen_labels
    bound = full + (none - full) * (1.0 / 3.0)
    n = _start_root(workspace, lane, candidate, j)
    for i in range(6):
        candidate[i, j] = math.nan
    depth = 0
    _bound_next_view(quadratic, chosen_labels, branch, depth, full, none)
    while depth >= 0:
        if branch[depth, _NEXT_STATE] == _STATES.shape[0]:
            depth -= 1
        elif _enter_state(quadratic, chosen_labels, branch, depth, bound, cost):
            if depth + 1 < n:
                depth += 1
                _bound_next_view(quadratic, chosen_labels, branch, depth, full, none)
                continue
            total = _finish_branch(workspace, lane, n, j, full, none)
            if total < cost - _MIN_IMPROVEMENT:
                cost = total
                # A single point comes first.
                first = 0 if lane.points[0, 1] == lane.points[0, 1] else 1
                for i in range(3):
                    candidate[i, j] = lane.points[first, 1 + i]
                    candidate[3 + i, j] = lane.points[1 - first, 1 + i]
