"""The point most views agree on: two-view hypotheses, a bounded score, robust refinement over every view.

Works on blocks of observation rows like :mod:`posefuse.kernels.points`. See docs/methods.md, "consensus".
"""

import math

import numpy as np

from posefuse.kernels import codes
from posefuse.kernels.jit import inline, kernel, step
from posefuse.kernels.points import (
    ACTIVE,
    BEHIND,
    COST,
    INFORMATION,
    MAX_ITERATIONS,
    OK,
    SCALE,
    SINGULAR,
    STATE_ROWS,
    SUM_ROWS,
    TOTAL,
    X,
    add_view,
    clear_sums,
    judge_geometry,
    normal_equations,
    solve_symmetric,
    store_points,
    take_step,
)
from posefuse.kernels.rows import BLOCK, residual, rows_block
from posefuse.kernels.views import (
    linear_errors,
    load_block,
    locate_lanes,
    reproject_block,
    store_view_results,
    weigh_block,
)

_GENEROUS_ROUNDS = 2
# A rival explanation must cost more than the best by this share of what a disagreeing view costs.
_CLEAR_LEAD = 0.5


@inline
def rank_views(trust, weights, ranks, used):
    """Order each lane's views by confidence, best first; views that are not used come last.

    Args:
        trust: shape (view, BLOCK).
        weights: shape (view, BLOCK); 0 is not used.
        ranks: shape (view, BLOCK), int64, written: the view of each rank.
        used: shape (BLOCK,), int64, written: how many are used.
    """
    n_views = weights.shape[0]
    for j in range(BLOCK):
        count = 0
        for v in range(n_views):
            if weights[v, j] > 0.0:
                place = count
                while place > 0 and trust[ranks[place - 1, j], j] < trust[v, j]:
                    ranks[place, j] = ranks[place - 1, j]
                    place -= 1
                ranks[place, j] = v
                count += 1
        used[j] = count
        for place in range(count, n_views):
            ranks[place, j] = 0


@inline
def two_view_point(rows, weights, j, a, b):
    """The algebraic point of views ``a`` and ``b`` of lane ``j``.

    Returns:
        ``(found, x, y, z)``, found 1.0 where there is one in front of both, else 0.0.
    """
    u = weights[a, j]
    w = weights[b, j]
    g0 = rows[a, 0, j]
    g1 = rows[a, 1, j]
    g2 = rows[a, 2, j]
    g3 = rows[a, 3, j]
    h0 = rows[a, 4, j]
    h1 = rows[a, 5, j]
    h2 = rows[a, 6, j]
    h3 = rows[a, 7, j]
    k0 = rows[b, 0, j]
    k1 = rows[b, 1, j]
    k2 = rows[b, 2, j]
    k3 = rows[b, 3, j]
    l0 = rows[b, 4, j]
    l1 = rows[b, 5, j]
    l2 = rows[b, 6, j]
    l3 = rows[b, 7, j]
    solved, x, y, z = solve_symmetric(
        u * (g0 * g0 + h0 * h0) + w * (k0 * k0 + l0 * l0),
        u * (g0 * g1 + h0 * h1) + w * (k0 * k1 + l0 * l1),
        u * (g0 * g2 + h0 * h2) + w * (k0 * k2 + l0 * l2),
        u * (g1 * g1 + h1 * h1) + w * (k1 * k1 + l1 * l1),
        u * (g1 * g2 + h1 * h2) + w * (k1 * k2 + l1 * l2),
        u * (g2 * g2 + h2 * h2) + w * (k2 * k2 + l2 * l2),
        -u * (g0 * g3 + h0 * h3) - w * (k0 * k3 + l0 * l3),
        -u * (g1 * g3 + h1 * h3) - w * (k1 * k3 + l1 * l3),
        -u * (g2 * g3 + h2 * h3) - w * (k2 * k3 + l2 * l3),
    )
    depth_a = rows[a, 8, j] * x + rows[a, 9, j] * y + rows[a, 10, j] * z + rows[a, 11, j]
    depth_b = rows[b, 8, j] * x + rows[b, 9, j] * y + rows[b, 10, j] * z + rows[b, 11, j]
    return 1.0 if solved & (depth_a > 0.0) & (depth_b > 0.0) else 0.0, x, y, z


@inline
def _score(rows, weights, bound, trial):
    """Sum over views of the squared residual in sigma units, each at most ``bound``; and how many lie below it.

    Rows 4 and 5 of ``trial`` receive them.
    """
    for j in range(BLOCK):
        trial[4, j] = 0.0
        trial[5, j] = 0.0
    for v in range(weights.shape[0]):
        for j in range(BLOCK):
            w = weights[v, j]
            depth, r, s = residual(rows, v, j, trial[0, j], trial[1, j], trial[2, j])
            squared = w * (r * r + s * s)
            near = (squared < bound) & (depth > 0.0)
            trial[4, j] += squared if near else (bound if w > 0.0 else 0.0)
            trial[5, j] += 1.0 if near & (w > 0.0) else 0.0


@inline
def search(rows, weights, ranks, used, pairs, enough, bound, trial, best):
    """The best-scoring two-view point of each lane.

    Args:
        rows: shape (view, 12, BLOCK).
        weights: shape (view, BLOCK).
        ranks: views by rank, from :func:`rank_views`.
        used: shape (BLOCK,), how many views each lane has.
        pairs: shape (pair, 2), int64: ranks to try together, the most promising first.
        enough: shape (view + 1, view + 1), int64: with so many views, of which so many agree, after how many tried
            pairs a better point is no longer to be expected.
        bound: what a view that disagrees costs, in squared sigma units.
        trial: shape (6, BLOCK), scratch.
        best: shape (7, BLOCK), written: point, pairs tried, cost, views that agree, pairs to try.
    """
    for j in range(BLOCK):
        best[3, j] = 0.0
        best[4, j] = math.inf
        best[5, j] = 0.0
        best[6, j] = enough[used[j], 0]
    for p in range(pairs.shape[0]):
        first = pairs[p, 0]
        second = pairs[p, 1]
        for j in range(BLOCK):
            trial[3, j], trial[0, j], trial[1, j], trial[2, j] = two_view_point(
                rows, weights, j, ranks[first, j], ranks[second, j]
            )
        _score(rows, weights, bound, trial)
        for j in range(BLOCK):
            # A lane that has tried enough takes no notice of what its neighbours still try.
            there = (second < used[j]) & (best[3, j] < best[6, j])
            better = there & (trial[3, j] > 0.0) & (trial[4, j] < best[4, j])
            best[0, j] = trial[0, j] if better else best[0, j]
            best[1, j] = trial[1, j] if better else best[1, j]
            best[2, j] = trial[2, j] if better else best[2, j]
            best[3, j] += 1.0 if there else 0.0
            best[4, j] = trial[4, j] if better else best[4, j]
            best[5, j] = trial[5, j] if better else best[5, j]
        waiting = 0
        for j in range(BLOCK):
            best[6, j] = enough[used[j], int(best[5, j])]
            waiting += 1 if best[3, j] < best[6, j] else 0
        if waiting == 0:
            break


@inline
def robust_equations(rows, weights, state, full, none, sums):
    """Reweighted Gauss-Newton equations: views within ``full`` count whole, beyond ``none`` not at all.

    Both in squared sigma units. Between them the weight falls as ``(1 - u)^2``, u from 0 to 1; the cost is its
    integral.
    """
    span = none - full
    inverse_span = 1.0 / span
    clear_sums(sums)
    for v in range(weights.shape[0]):
        for j in range(BLOCK):
            depth, r, s = residual(rows, v, j, state[X, j], state[X + 1, j], state[X + 2, j])
            weight = weights[v, j]
            squared = weight * (r * r + s * s)
            squared = squared if depth > 0.0 else none
            u = min(max((squared - full) * inverse_span, 0.0), 1.0)
            fall = 1.0 - u
            add_view(rows, v, j, depth, r, s, weight * fall * fall, sums)
            cost = min(squared, full) + span * (1.0 - fall * fall * fall) * (1.0 / 3.0)
            sums[TOTAL, j] += cost if weight > 0.0 else 0.0


@inline
def refine(rows, weights, full, none, sums, state, lanes):
    """Robust points of the lanes that come in ACTIVE, from the points in ``state``: first generously, then strictly."""
    # One loop for both, so that its body is compiled once.
    for turn in range(_GENEROUS_ROUNDS + MAX_ITERATIONS):
        if turn == _GENEROUS_ROUNDS:
            for j in range(BLOCK):
                lanes[j] = ACTIVE if lanes[j] == OK else lanes[j]
                state[COST, j] = math.inf
                state[SCALE, j] = 1.0
        widening = 4.0 if turn < _GENEROUS_ROUNDS else 1.0
        robust_equations(rows, weights, state, widening * full, widening * none, sums)
        active = take_step(sums, state, lanes)
        if (active == 0) & (turn >= _GENEROUS_ROUNDS):
            break
    # Weights that change with the point make the last steps slow or vain; each that was taken lowered the cost, so
    # where there is a cost there is a point.
    for j in range(BLOCK):
        stuck = (lanes[j] == ACTIVE) | (lanes[j] == BEHIND)
        lanes[j] = OK if stuck & (state[COST, j] < math.inf) else lanes[j]


@inline
def accept(rows, weights, state, none, accepted, agreeing):
    """The views within reach of each lane's point.

    Args:
        rows: shape (view, 12, BLOCK).
        weights: shape (view, BLOCK).
        state: the points.
        none: from so many squared sigmas on a view disagrees.
        accepted: shape (view, BLOCK), written: the weights, 0 for views that disagree.
        agreeing: shape (BLOCK,), int64, written: how many agree.
    """
    for j in range(BLOCK):
        agreeing[j] = 0
    for v in range(weights.shape[0]):
        for j in range(BLOCK):
            w = weights[v, j]
            depth, r, s = residual(rows, v, j, state[X, j], state[X + 1, j], state[X + 2, j])
            near = (w * (r * r + s * s) < none) & (depth > 0.0) & (w > 0.0)
            accepted[v, j] = w if near else 0.0
            agreeing[j] += 1 if near else 0


@inline
def _start(best, min_views, used, state, lanes):
    """Begin the refinement of every lane that has a hypothesis and views enough."""
    for j in range(BLOCK):
        for i in range(3):
            state[X + i, j] = best[i, j]
        state[COST, j] = math.inf
        state[SCALE, j] = 1.0
        lanes[j] = ACTIVE if (used[j] >= min_views) & (best[4, j] < math.inf) else OK


@inline
def _keep_information(sums, state):
    """What the accepted views tell, each at its full weight."""
    for i in range(6):
        for j in range(BLOCK):
            state[INFORMATION + i, j] = sums[i, j]


@inline
def _mark_outliers(accepted, status, view_codes):
    """Views that were there and disagree."""
    for v in range(accepted.shape[0]):
        for j in range(BLOCK):
            rejected = (view_codes[v, j] == codes.VIEW_USED) & (accepted[v, j] == 0.0)
            rejected = rejected & (status[j] < codes.POINT_MISSING)
            view_codes[v, j] = codes.VIEW_OUTLIER if rejected else view_codes[v, j]


@step
def _rival(rows, weights, accepted, j, bound):
    """The cost of the best two-view point of lane ``j`` that rests on a view which was not accepted."""
    n_views = weights.shape[0]
    lowest = math.inf
    for a in range(n_views):
        for b in range(a):
            if weights[a, j] == 0.0 or weights[b, j] == 0.0 or (accepted[a, j] > 0.0 and accepted[b, j] > 0.0):
                continue
            found, x, y, z = two_view_point(rows, weights, j, a, b)
            if found == 0.0:
                continue
            cost = 0.0
            for v in range(n_views):
                if weights[v, j] > 0.0:
                    depth, r, s = residual(rows, v, j, x, y, z)
                    squared = weights[v, j] * (r * r + s * s)
                    cost += squared if depth > 0.0 and squared < bound else bound
            lowest = min(lowest, cost)
    return lowest


@inline
def _judge(rows, weights, accepted, best, bound, min_views, used, agreeing, lanes, status):
    """From what came of the search to point codes."""
    for j in range(BLOCK):
        code = codes.POINT_OK if agreeing[j] > 2 else codes.POINT_TWO_VIEWS
        if used[j] < min_views:
            code = codes.POINT_NOT_SEEN if used[j] == 0 else codes.POINT_TOO_FEW_VIEWS
        elif lanes[j] == BEHIND or best[4, j] == math.inf:
            code = codes.POINT_BEHIND_CAMERA
        elif lanes[j] == ACTIVE:
            code = codes.POINT_NO_CONVERGENCE
        elif agreeing[j] < min_views:
            code = codes.POINT_OUTLIER
        elif lanes[j] == SINGULAR:
            code = codes.POINT_DEGENERATE
        elif agreeing[j] < used[j] and (agreeing[j] <= 3 or 2 * agreeing[j] <= used[j] + 1):
            rival = _rival(rows, weights, accepted, j, bound)
            code = codes.POINT_AMBIGUOUS if rival < best[4, j] + _CLEAR_LEAD * bound else code
        status[j] = code


@kernel
def triangulate_consensus(
    cameras,
    keypoints_px,
    confidence,
    rows_of,
    scale_px,
    exponent,
    min_confidence,
    min_views,
    pairs,
    enough,
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
    """Points that most views agree on, and which views those are.

    Args:
        cameras: the camera array, shape (view, COLUMNS).
        keypoints_px: shape (detection, keypoint, 2), NaN where missing.
        confidence: shape (detection, keypoint), NaN where the detector gives none.
        rows_of: shape (person_frame, view), int64: rows of the two above, or NO_DETECTION or NOT_RECORDED.
        scale_px: shape (view,): the noise of a detection of confidence 1, in px per axis.
        exponent: the noise is ``scale_px / confidence^exponent``.
        min_confidence: detections below are not used.
        min_views: points with fewer agreeing views are missing (at least 2).
        pairs: shape (pair, 2), int64, see :func:`search`.
        enough: shape (view + 1, view + 1), int64, see :func:`search`.
        bound_sigma: hypotheses: a residual of more sigmas costs no more.
        full_sigma: refinement: a residual of fewer sigmas counts whole.
        none_sigma: refinement: a residual of more sigmas does not count; the view disagrees.
        points: shape (person_frame, keypoint, 3), written.
        covariance: shape (person_frame, keypoint, 6), written: xx xy xz yy yz zz.
        status: shape (person_frame, keypoint), int8, written: point codes.
        view_codes: shape (person_frame, keypoint, view), int8, written.
        view_errors_px: shape (person_frame, keypoint, view), float32, written: reprojection errors of every view that
            has a detection, used or not.
        mean_errors_px: shape (person_frame, keypoint), written: mean of the errors of the used views.
    """
    n_views = cameras.shape[0]
    n_keypoints = keypoints_px.shape[1]
    total = rows_of.shape[0] * n_keypoints
    pixels = np.empty((n_views, 2, BLOCK))
    trust = np.empty((n_views, BLOCK))
    rows = np.empty((n_views, 12, BLOCK))
    weights = np.empty((n_views, BLOCK))
    accepted = np.empty((n_views, BLOCK))
    errors = np.empty((n_views, BLOCK))
    lens_codes = np.empty((n_views, BLOCK), np.int64)
    block_codes = np.empty((n_views, BLOCK), np.int64)
    ranks = np.empty((n_views, BLOCK), np.int64)
    scratch = np.empty((6, BLOCK))
    trial = np.empty((6, BLOCK))
    best = np.empty((7, BLOCK))
    sums = np.empty((SUM_ROWS, BLOCK))
    state = np.empty((STATE_ROWS, BLOCK))
    places = np.empty((2, BLOCK), np.int64)
    used = np.empty(BLOCK, np.int64)
    agreeing = np.empty(BLOCK, np.int64)
    lanes = np.empty(BLOCK, np.int64)
    point_codes = np.empty(BLOCK, np.int64)
    bound = bound_sigma * bound_sigma
    full = full_sigma * full_sigma
    none = none_sigma * none_sigma
    for first in range(0, total, BLOCK):
        locate_lanes(first, total, n_keypoints, places)
        load_block(keypoints_px, confidence, rows_of, places, min_confidence, pixels, trust, block_codes)
        for v in range(n_views):
            rows_block(cameras, v, pixels, lens_codes, rows, scratch)
        weigh_block(scale_px, exponent, trust, lens_codes, block_codes, weights)
        rank_views(trust, weights, ranks, used)
        search(rows, weights, ranks, used, pairs, enough, bound, trial, best)
        _start(best, min_views, used, state, lanes)
        refine(rows, weights, full, none, sums, state, lanes)
        accept(rows, weights, state, none, accepted, agreeing)
        _judge(rows, weights, accepted, best, bound, min_views, used, agreeing, lanes, point_codes)
        normal_equations(rows, accepted, state, sums)
        _keep_information(sums, state)
        judge_geometry(state, sums, point_codes)
        reproject_block(cameras, pixels, state, errors)
        linear_errors(rows, accepted, state, errors)
        _mark_outliers(accepted, point_codes, block_codes)
        store_points(state, sums, point_codes, places, points, covariance, status)
        store_view_results(block_codes, errors, point_codes, places, view_codes, view_errors_px, mean_errors_px)
