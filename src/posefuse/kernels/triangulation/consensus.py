"""Consensus triangulation: two-view hypotheses, a bounded score, and robust refinement over all views.

It works on blocks of observation rows like :mod:`posefuse.kernels.cameras.points`. See docs/methods/triangulation.md.
"""

import math

import numpy as np

from posefuse.kernels import status_codes
from posefuse.kernels.cameras.observation_blocks import (
    compute_weights,
    fill_linearized_errors,
    load_block,
    reproject_block,
    store_view_results,
)
from posefuse.kernels.cameras.observation_rows import BLOCK, residual, rows_block
from posefuse.kernels.cameras.points import (
    ACTIVE,
    BEHIND,
    COST,
    INFORMATION,
    OK,
    SCALE,
    SINGULAR,
    STATE_ROWS,
    X,
    judge_geometry,
    linear_start,
    normal_equations,
    open_lanes,
    store_points,
)
from posefuse.kernels.jit import inline, kernel, subroutine
from posefuse.kernels.triangulation.block_queue import (
    EARLY,
    QUICK,
    next_block,
    postpone_contested,
    postpone_undecided,
)
from posefuse.kernels.triangulation.pair_search import gather_pair, rank_views, search_pairs, two_view_point
from posefuse.kernels.triangulation.robust_refinement import CURVATURE, accept, refine

# A point is ambiguous if a rival costs less than this fraction of an outlier view more.
_CLEAR_LEAD = 0.5


# A point is undecided if the costs differ by less than this fraction and the points by more than this distance.
_TIE = 0.075


_MIN_DISTANCE_SQUARED = 36.0


@inline
def _start_lanes(best, min_views, n_used, state, lane_status):
    """Start the refinement of every lane that has a hypothesis and enough views."""
    for j in range(BLOCK):
        for i in range(3):
            state[X + i, j] = best[i, j]
        state[COST, j] = math.inf
        state[SCALE, j] = 1.0
        lane_status[j] = ACTIVE if (n_used[j] >= min_views) & (best[4, j] < math.inf) else OK


@inline
def _start_from_all_views(rows, weights, min_views, sums, state, n_used, lane_status):
    """Start at the algebraic points of all views."""
    open_lanes(weights, min_views, lane_status, n_used)
    linear_start(rows, weights, sums, state, lane_status)
    for j in range(BLOCK):
        lane_status[j] = SINGULAR if n_used[j] < min_views else lane_status[j]


@inline
def _compute_covariance(rows, accepted, thorough, sums, state, status):
    """Write covariances from the accepted views at full weight into the first six rows of ``sums``."""
    # If all views were accepted, the last step has already computed the information.
    if thorough:
        normal_equations(rows, accepted, state, sums)
        for i in range(6):
            for j in range(BLOCK):
                state[INFORMATION + i, j] = sums[i, j]
    judge_geometry(state, sums, status)


@inline
def _mark_outliers(accepted, status, view_codes):
    """Mark used views that were rejected as outliers."""
    for v in range(accepted.shape[0]):
        for j in range(BLOCK):
            rejected = (view_codes[v, j] == status_codes.VIEW_USED) & (accepted[v, j] == 0.0)
            rejected = rejected & (status[j] < status_codes.POINT_MISSING)
            view_codes[v, j] = status_codes.VIEW_OUTLIER if rejected else view_codes[v, j]


@subroutine
def _rival(rows, weights, accepted, j, bound, pair, pair_weights):
    """Return ``(cost, x, y, z)`` of the best two-view point of lane ``j`` that uses at least one rejected view."""
    n_views = weights.shape[0]
    lowest_cost = math.inf
    best_x = math.nan
    best_y = math.nan
    best_z = math.nan
    for a in range(n_views):
        for b in range(a):
            if weights[a, j] == 0.0 or weights[b, j] == 0.0 or (accepted[a, j] > 0.0 and accepted[b, j] > 0.0):
                continue
            gather_pair(rows, weights, a, b, j, pair, pair_weights)
            found, x, y, z = two_view_point(pair, pair_weights, j)
            if found == 0.0:
                continue
            cost = 0.0
            for v in range(n_views):
                if weights[v, j] > 0.0:
                    depth, r, s = residual(rows, v, j, x, y, z)
                    squared = weights[v, j] * (r * r + s * s)
                    cost += squared if depth > 0.0 and squared < bound else bound
            if cost < lowest_cost:
                lowest_cost = cost
                best_x = x
                best_y = y
                best_z = z
    return lowest_cost, best_x, best_y, best_z


@subroutine
def _rival_code(rows, weights, accepted, state, j, cost, bound, pair, pair_weights):
    """Return the code of a point with a bare majority of views: undecided or ambiguous if it has a rival, else OK."""
    rival_cost, x, y, z = _rival(rows, weights, accepted, j, bound, pair, pair_weights)
    if rival_cost >= cost + _CLEAR_LEAD * bound:
        return status_codes.POINT_OK
    x -= state[X, j]
    y -= state[X + 1, j]
    z -= state[X + 2, j]
    i = INFORMATION
    distance_squared = x * (state[i, j] * x + 2.0 * (state[i + 1, j] * y + state[i + 2, j] * z))
    distance_squared += y * (state[i + 3, j] * y + 2.0 * state[i + 4, j] * z) + z * z * state[i + 5, j]
    tie = rival_cost < cost + _TIE * bound and distance_squared > _MIN_DISTANCE_SQUARED
    return status_codes.POINT_UNDECIDED if tie else status_codes.POINT_AMBIGUOUS


@inline
def _assign_point_codes(
    rows, weights, accepted, best, bound, min_views, n_used, n_agreeing, state, lane_status, pair, pair_weights, status
):
    """Convert the outcome of the search to point codes."""
    for j in range(BLOCK):
        code = status_codes.POINT_OK if n_agreeing[j] > 2 else status_codes.POINT_TWO_VIEWS
        if n_used[j] < min_views:
            code = status_codes.POINT_NOT_SEEN if n_used[j] == 0 else status_codes.POINT_TOO_FEW_VIEWS
        elif lane_status[j] == BEHIND or best[4, j] == math.inf:
            code = status_codes.POINT_BEHIND_CAMERA
        elif lane_status[j] == ACTIVE:
            code = status_codes.POINT_NO_CONVERGENCE
        elif n_agreeing[j] < min_views:
            code = status_codes.POINT_OUTLIER
        elif lane_status[j] == SINGULAR:
            code = status_codes.POINT_DEGENERATE
        elif n_agreeing[j] < n_used[j] and (n_agreeing[j] <= 3 or 2 * n_agreeing[j] <= n_used[j] + 1):
            code = max(code, _rival_code(rows, weights, accepted, state, j, best[4, j], bound, pair, pair_weights))
        status[j] = code


@kernel
def triangulate_consensus(
    cameras,
    distorted,
    fisheye,
    keypoints_px,
    confidence,
    detection_rows,
    scale_px,
    exponent,
    min_confidence,
    min_views,
    pairs,
    required_tries,
    early_limit,
    bound_sigma,
    full_sigma,
    none_sigma,
    points,
    covariance,
    status,
    view_codes,
    view_errors_px,
    mean_errors_px,
):
    """Triangulate the points that most views agree on, and identify these views.

    Args:
        cameras: the camera array, shape (view, COLUMNS).
        distorted: None if the rig has no lens with distortion polynomials.
        fisheye: None if the rig has no fisheye lens.
        keypoints_px: shape (detection, keypoint, 2), NaN where missing.
        confidence: shape (detection, keypoint), NaN where the detector gives none.
        detection_rows: shape (person_frame, view), int64: rows of the two arrays above, NO_DETECTION or NOT_RECORDED.
        scale_px: shape (view,): noise of a detection of confidence 1, in px per axis.
        exponent: the noise is ``scale_px / confidence^exponent``.
        min_confidence: detections below this confidence are not used.
        min_views: points with fewer agreeing views are missing (at least 2).
        pairs: shape (pair, 2), int64, see :func:`posefuse.kernels.triangulation.pair_search.search_pairs`.
        required_tries: shape (view + 1, view + 1), int64, see the same function.
        early_limit: number of pairs after which the few undecided points of a block move to blocks of their own; 0 to
            disable.
        bound_sigma: hypotheses: the cost of a residual is capped at this many sigmas.
        full_sigma: refinement: a residual of fewer sigmas has full weight.
        none_sigma: refinement: a residual of more sigmas has weight 0; the view is an outlier.
        points: shape (person_frame, keypoint, 3), written.
        covariance: shape (person_frame, keypoint, 6), written: xx xy xz yy yz zz.
        status: shape (person_frame, keypoint), int8, written: point codes.
        view_codes: shape (person_frame, keypoint, view), int8, written.
        view_errors_px: shape (person_frame, keypoint, view), float32, written: reprojection errors of every view that
            has a detection, used or not.
        mean_errors_px: shape (person_frame, keypoint), written: mean error over the used views.
    """
    n_views = cameras.shape[0]
    n_keypoints = keypoints_px.shape[1]
    total = detection_rows.shape[0] * n_keypoints
    pixels = np.empty((n_views, 2, BLOCK))
    block_confidence = np.empty((n_views, BLOCK))
    rows = np.empty((n_views, 12, BLOCK))
    weights = np.empty((n_views, BLOCK))
    accepted = np.empty((n_views, BLOCK))
    errors = np.empty((n_views, BLOCK))
    lens_codes = np.empty((n_views, BLOCK), np.int64)
    block_codes = np.empty((n_views, BLOCK), np.int64)
    ranks = np.empty((n_views, BLOCK), np.int64)
    pair, pair_weights = np.empty((2, 12, BLOCK)), np.empty((2, BLOCK))
    scratch, best = np.empty((6, BLOCK)), np.empty((7, BLOCK))
    sums = np.empty((CURVATURE + 6, BLOCK))
    state = np.empty((STATE_ROWS, BLOCK))
    lane_indices = np.empty((2, BLOCK), np.int64)
    n_used = np.empty(BLOCK, np.int64)
    n_agreeing = np.empty(BLOCK, np.int64)
    lane_status = np.empty(BLOCK, np.int64)
    point_codes = np.empty(BLOCK, np.int64)
    bound, full, none = bound_sigma * bound_sigma, full_sigma * full_sigma, none_sigma * none_sigma
    pending, n_pending = np.empty((2, total), np.int64), np.zeros(2, np.int64)
    # A literal 0 has its own type, for which the callee would be compiled a second time.
    pending, n_pending, first = np.empty((2, total), np.int64), np.zeros(2, np.int64), np.int64(0)
    while first < total or n_pending[0] + n_pending[1] > 0:
        mode, first = next_block(first, total, n_views, n_keypoints, early_limit, pending, n_pending, lane_indices)
        thorough = mode != QUICK
        load_block(
            keypoints_px,
            confidence,
            detection_rows,
            lane_indices,
            min_confidence,
            pixels,
            block_confidence,
            block_codes,
        )
        for v in range(n_views):
            rows_block(cameras, distorted, fisheye, v, pixels, lens_codes, rows, scratch)
        compute_weights(scale_px, exponent, block_confidence, lens_codes, block_codes, weights)
        if thorough:
            rank_views(block_confidence, weights, ranks, n_used)
            limit = early_limit if mode == EARLY else 0
            n_undecided = search_pairs(
                rows, weights, ranks, n_used, pairs, required_tries, limit, bound, pair, pair_weights, scratch, best
            )
            postpone_undecided(n_undecided, lane_indices, n_keypoints, best, n_used, pending, n_pending)
            _start_lanes(best, min_views, n_used, state, lane_status)
        else:
            _start_from_all_views(rows, weights, min_views, sums, state, n_used, lane_status)
        refine(rows, weights, thorough, full, none, n_used, sums, state, lane_status)
        accept(rows, weights, state, none if thorough else full, accepted, n_agreeing)
        if not thorough:
            postpone_contested(
                lane_indices,
                n_keypoints,
                min_views,
                early_limit,
                n_used,
                n_agreeing,
                lane_status,
                best,
                pending,
                n_pending,
            )
        _assign_point_codes(
            rows, weights, accepted, best, bound, min_views, n_used, n_agreeing, state, lane_status, pair,
            pair_weights, point_codes,
        )  # fmt: skip
        _compute_covariance(rows, accepted, thorough, sums, state, point_codes)
        reproject_block(cameras, distorted, fisheye, pixels, state, errors)
        fill_linearized_errors(rows, accepted, state, errors)
        _mark_outliers(accepted, point_codes, block_codes)
        store_points(state, sums, point_codes, lane_indices, points, covariance, status)
        store_view_results(block_codes, errors, point_codes, lane_indices, view_codes, view_errors_px, mean_errors_px)
