"""What two settled points rest on: each view's state, the order of the points, statuses and errors."""

import math

from posefuse.kernels import status_codes
from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.cameras.points import COST, INFORMATION, SCALE, X
from posefuse.kernels.jit import inline, step
from posefuse.kernels.left_right.refine import COUPLE_COST, squared_residual
from posefuse.kernels.left_right.search import bounded

NONE = -1
"""In the place of a label: no observation."""


@inline
def assign(rows, weights, full, none, couple, labels, evidence):
    """Put every view into the state that costs least.

    Args:
        rows: shape (label, view, 12, BLOCK).
        weights: shape (label, view, BLOCK).
        full, none: see :func:`posefuse.kernels.left_right.search.bounded`; from ``none`` on no observation is a point's.
        couple: shape (COUPLE_ROWS, BLOCK).
        labels: shape (side, view, BLOCK), int64, written: the label of the observation that each point rests on.
        evidence: shape (view, BLOCK), written: cost as labelled less cost swapped.
    """
    inverse_span = 1.0 / (none - full)
    for v in range(weights.shape[1]):
        for j in range(BLOCK):
            e0l = squared_residual(rows[0], weights[0], v, j, couple, 0, none)
            e0r = squared_residual(rows[1], weights[1], v, j, couple, 0, none)
            e1l = squared_residual(rows[0], weights[0], v, j, couple, 3, none)
            e1r = squared_residual(rows[1], weights[1], v, j, couple, 3, none)
            straight = bounded(e0l, full, inverse_span) + bounded(e1r, full, inverse_span)
            crossed = bounded(e0r, full, inverse_span) + bounded(e1l, full, inverse_span)
            as_labelled = straight <= crossed
            evidence[v, j] = straight - crossed
            near_0 = (e0l if as_labelled else e0r) < none
            near_1 = (e1r if as_labelled else e1l) < none
            labels[0, v, j] = (0 if as_labelled else 1) if near_0 else NONE
            labels[1, v, j] = (1 if as_labelled else 0) if near_1 else NONE


@step
def put_in_order(trust, couple, labels, evidence):
    """Make the first point the one that most labels, weighed by confidence, call left.

    Args:
        trust: shape (label, view, BLOCK).
        couple: shape (COUPLE_ROWS, BLOCK), in and out.
        labels: shape (side, view, BLOCK), in and out.
        evidence: shape (view, BLOCK), in and out.
    """
    n_views = evidence.shape[0]
    for j in range(BLOCK):
        votes = 0.0
        against = 0.0
        for v in range(n_views):
            for side in range(2):
                label = labels[side, v, j]
                if label != NONE:
                    votes += trust[label, v, j] if label == side else -trust[label, v, j]
            against += evidence[v, j]
        if votes > 0.0 or (votes == 0.0 and against <= 0.0):
            continue
        for i in range(3):
            couple[i, j], couple[3 + i, j] = couple[3 + i, j], couple[i, j]
        for v in range(n_views):
            labels[0, v, j], labels[1, v, j] = labels[1, v, j], labels[0, v, j]
            evidence[v, j] = -evidence[v, j]


@inline
def take_side(room, side):
    """Gather the observations that one of the points rests on, and begin its state."""
    for j in range(BLOCK):
        room.agreeing[j] = 0
        room.valid[j] = 0
        room.rays[j] = 0
        for i in range(3):
            room.state[X + i, j] = room.couple[3 * side + i, j]
        room.state[COST, j] = 0.0
        room.state[SCALE, j] = 1.0
    for v in range(room.side_weights.shape[0]):
        for j in range(BLOCK):
            label = room.labels[side, v, j]
            there = label != NONE
            label = label if there else 0
            room.agreeing[j] += 1 if there else 0
            room.side_weights[v, j] = room.weights[label, v, j] if there else 0.0
            for i in range(12):
                room.side_rows[v, i, j] = room.rows[label, v, i, j]
            for i in range(2):
                room.side_pixels[v, i, j] = room.pixels[label, v, i, j] if there else math.nan
            # Observations that the other point does not rest on.
            for other in range(2):
                taken = (room.labels[1 - side, v, j] == other) | (not room.weights[other, v, j] > 0.0)
                room.valid[j] += 0 if taken else 1
                room.rays[j] += 1 if room.weights[other, v, j] > 0.0 else 0


@inline
def keep_information(sums, state):
    """The information of a point, from the sums of its normal equations."""
    for i in range(6):
        for j in range(BLOCK):
            state[INFORMATION + i, j] = sums[i, j]


@step
def judge_side(couple, side, bound_moved, min_views, moved, agreeing, valid, rays, status):
    """Point codes, from how many views a point rests on.

    Args:
        couple: shape (COUPLE_ROWS, BLOCK).
        side: which point.
        bound_moved: a last step (squared standard errors) above did not settle.
        min_views: fewer are not enough.
        moved: shape (BLOCK,), the last step.
        agreeing: shape (BLOCK,), views it rests on.
        valid: shape (BLOCK,), observations that could have been its.
        rays: shape (BLOCK,), all observations of the couple.
        status: shape (BLOCK,), int64, written.
    """
    for j in range(BLOCK):
        # Which of a view's two rays is whose, two views can hardly tell.
        code = status_codes.POINT_OK
        if agreeing[j] == 2:
            code = status_codes.POINT_AMBIGUOUS if rays[j] > 2 else status_codes.POINT_TWO_VIEWS
        if valid[j] < min_views:
            code = status_codes.POINT_NOT_SEEN if valid[j] == 0 else status_codes.POINT_TOO_FEW_VIEWS
        elif agreeing[j] < min_views or couple[3 * side, j] != couple[3 * side, j]:
            code = status_codes.POINT_OUTLIER
        elif not moved[j] < bound_moved:
            code = status_codes.POINT_NO_CONVERGENCE
        status[j] = code


@step
def store_side(room, side, used, view_errors_px):
    """Write what the points of one side rest on."""
    for j in range(BLOCK):
        n = room.places[0, j]
        k = room.places[1, j]
        if n < 0:
            continue
        solved = room.status[j] < status_codes.POINT_MISSING
        for v in range(room.side_weights.shape[0]):
            label = room.labels[side, v, j] if solved else NONE
            room.labels[side, v, j] = label
            used[n, k, v, side] = label
            view_errors_px[n, k, v, side] = room.side_errors[v, j] if label != NONE else math.nan


@step
def store_views(room, bound, view_codes, evidence, costs):
    """Write what became of every observation, and what the views say of their labels."""
    n_views = room.side_weights.shape[0]
    for j in range(BLOCK):
        n = room.places[0, j]
        k = room.places[1, j]
        if n < 0:
            continue
        solved = room.couple[X, j] == room.couple[X, j] or room.couple[X + 3, j] == room.couple[X + 3, j]
        costs[n, k] = room.couple[COUPLE_COST, j] if solved else math.nan
        for v in range(n_views):
            evidence[n, k, v] = room.evidence[v, j]
            for label in range(2):
                # An observation that is not there has cost as much as one that is not explained.
                costs[n, k] -= 0.0 if room.weights[label, v, j] > 0.0 else bound
                code = room.codes[label, v, j]
                taken = room.labels[0, v, j] == label or room.labels[1, v, j] == label
                if code == status_codes.VIEW_USED and not taken:
                    code = status_codes.VIEW_OUTLIER
                view_codes[n, k, v, label] = code
