"""Results of refined candidates: the state of each view, the order of the points, status codes and errors."""

import math

from posefuse.kernels import status_codes
from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.cameras.points import COST, INFORMATION, SCALE, X
from posefuse.kernels.jit import inline, subroutine
from posefuse.kernels.left_right.refine import CANDIDATE_COST, LAST_STEP, squared_residual
from posefuse.kernels.left_right.search import bounded

NONE = -1
"""Label of a point without an observation in a view."""


@inline
def assign_views(rows, weights, full, none, candidate, labels, evidence):
    """Assign every view to its cheapest state.

    Args:
        rows: shape (label, view, 12, BLOCK).
        weights: shape (label, view, BLOCK).
        full, none: see :func:`posefuse.kernels.left_right.search.bounded`; at ``none`` or beyond, an observation
            belongs to no point.
        candidate: shape (CANDIDATE_ROWS, BLOCK).
        labels: shape (side, view, BLOCK), int64, written: the label of the observation that supports each point.
        evidence: shape (view, BLOCK), written: cost as labeled minus cost swapped.
    """
    inverse_span = 1.0 / (none - full)
    for v in range(weights.shape[1]):
        for j in range(BLOCK):
            e0l = squared_residual(rows[0], weights[0], v, j, candidate, 0, none)
            e0r = squared_residual(rows[1], weights[1], v, j, candidate, 0, none)
            e1l = squared_residual(rows[0], weights[0], v, j, candidate, 3, none)
            e1r = squared_residual(rows[1], weights[1], v, j, candidate, 3, none)
            unswapped_cost = bounded(e0l, full, inverse_span) + bounded(e1r, full, inverse_span)
            swapped_cost = bounded(e0r, full, inverse_span) + bounded(e1l, full, inverse_span)
            as_labelled = unswapped_cost <= swapped_cost
            evidence[v, j] = unswapped_cost - swapped_cost
            inlier_0 = (e0l if as_labelled else e0r) < none
            inlier_1 = (e1r if as_labelled else e1l) < none
            labels[0, v, j] = (0 if as_labelled else 1) if inlier_0 else NONE
            labels[1, v, j] = (1 if as_labelled else 0) if inlier_1 else NONE


@subroutine
def order_points(block_confidence, candidate, labels, evidence):
    """Order the points so that the first is the one that most labels, weighted by confidence, call left.

    Args:
        block_confidence: shape (label, view, BLOCK).
        candidate: shape (CANDIDATE_ROWS, BLOCK), in and out.
        labels: shape (side, view, BLOCK), in and out.
        evidence: shape (view, BLOCK), in and out.
    """
    n_views = evidence.shape[0]
    for j in range(BLOCK):
        votes = 0.0
        swap_evidence = 0.0
        for v in range(n_views):
            for side in range(2):
                label = labels[side, v, j]
                if label != NONE:
                    votes += block_confidence[label, v, j] if label == side else -block_confidence[label, v, j]
            swap_evidence += evidence[v, j]
        if votes > 0.0 or (votes == 0.0 and swap_evidence <= 0.0):
            continue
        for i in range(3):
            candidate[i, j], candidate[3 + i, j] = candidate[3 + i, j], candidate[i, j]
        for v in range(n_views):
            labels[0, v, j], labels[1, v, j] = labels[1, v, j], labels[0, v, j]
            evidence[v, j] = -evidence[v, j]


@inline
def gather_side(workspace, side):
    """Gather the observations that support one of the points, and initialize its state."""
    for j in range(BLOCK):
        workspace.n_agreeing[j] = 0
        workspace.n_valid[j] = 0
        workspace.n_rays[j] = 0
        for i in range(3):
            workspace.state[X + i, j] = workspace.candidate[3 * side + i, j]
        workspace.state[COST, j] = 0.0
        workspace.state[SCALE, j] = 1.0
    for v in range(workspace.side_weights.shape[0]):
        for j in range(BLOCK):
            label = workspace.labels[side, v, j]
            exists = label != NONE
            label = label if exists else 0
            workspace.n_agreeing[j] += 1 if exists else 0
            workspace.side_weights[v, j] = workspace.weights[label, v, j] if exists else 0.0
            for i in range(12):
                workspace.side_rows[v, i, j] = workspace.rows[label, v, i, j]
            for i in range(2):
                workspace.side_pixels[v, i, j] = workspace.pixels[label, v, i, j] if exists else math.nan
            # Count the observations that do not support the other point.
            for other in range(2):
                assigned = (workspace.labels[1 - side, v, j] == other) | (not workspace.weights[other, v, j] > 0.0)
                workspace.n_valid[j] += 0 if assigned else 1
                workspace.n_rays[j] += 1 if workspace.weights[other, v, j] > 0.0 else 0


@inline
def keep_information(sums, state):
    """Copy the information of a point from the sums of its normal equations."""
    for i in range(6):
        for j in range(BLOCK):
            state[INFORMATION + i, j] = sums[i, j]


@subroutine
def assign_side_codes(workspace, side, max_last_step, min_views):
    """Assign point codes from the number of supporting views.

    Args:
        workspace: a Workspace; its status is written.
        side: which point.
        max_last_step: a larger last step (squared standard errors) means no convergence.
        min_views: minimum number of views.
    """
    candidate, status = workspace.candidate, workspace.status
    n_agreeing, n_valid, n_rays = workspace.n_agreeing, workspace.n_valid, workspace.n_rays
    for j in range(BLOCK):
        # With two views, the assignment of rays to points is hardly determined.
        code = status_codes.POINT_OK
        if n_agreeing[j] == 2:
            code = status_codes.POINT_AMBIGUOUS if n_rays[j] > 2 else status_codes.POINT_TWO_VIEWS
        if n_valid[j] < min_views:
            code = status_codes.POINT_NOT_SEEN if n_valid[j] == 0 else status_codes.POINT_TOO_FEW_VIEWS
        elif n_agreeing[j] < min_views or candidate[3 * side, j] != candidate[3 * side, j]:
            code = status_codes.POINT_OUTLIER
        elif not candidate[LAST_STEP, j] < max_last_step:
            code = status_codes.POINT_NO_CONVERGENCE
        status[j] = code


@subroutine
def store_side_results(workspace, side, out):
    """Write to ``out`` the label and the error of the observations that support the points of one side."""
    for j in range(BLOCK):
        n = workspace.lane_indices[0, j]
        k = workspace.lane_indices[1, j]
        if n < 0:
            continue
        solved = workspace.status[j] < status_codes.POINT_MISSING
        for v in range(workspace.side_weights.shape[0]):
            label = workspace.labels[side, v, j] if solved else NONE
            workspace.labels[side, v, j] = label
            out.used[n, k, v, side] = label
            out.view_errors_px[n, k, v, side] = workspace.side_errors[v, j] if label != NONE else math.nan


@subroutine
def store_view_outcomes(workspace, bound, out):
    """Write to ``out`` the outcome of every observation, the costs, and the evidence of the views for their labels."""
    n_views = workspace.side_weights.shape[0]
    for j in range(BLOCK):
        n = workspace.lane_indices[0, j]
        k = workspace.lane_indices[1, j]
        if n < 0:
            continue
        solved = (
            workspace.candidate[X, j] == workspace.candidate[X, j]
            or workspace.candidate[X + 3, j] == workspace.candidate[X + 3, j]
        )
        out.costs[n, k] = workspace.candidate[CANDIDATE_COST, j] if solved else math.nan
        for v in range(n_views):
            out.evidence[n, k, v] = workspace.evidence[v, j]
            for label in range(2):
                # A missing observation has the cost of an unexplained one.
                out.costs[n, k] -= 0.0 if workspace.weights[label, v, j] > 0.0 else bound
                code = workspace.codes[label, v, j]
                assigned = workspace.labels[0, v, j] == label or workspace.labels[1, v, j] == label
                if code == status_codes.VIEW_USED and not assigned:
                    code = status_codes.VIEW_OUTLIER
                out.view_codes[n, k, v, label] = code
