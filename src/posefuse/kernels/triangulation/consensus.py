"""The point most views agree on: two-view hypotheses, a bounded score, robust refinement over every view.

Works on blocks of observation rows like :mod:`posefuse.kernels.cameras.points`. See docs/methods.md, "consensus".
"""

import math

import numpy as np

from posefuse.kernels import status_codes
from posefuse.kernels.cameras.observation_rows import BLOCK, residual, rows_block
from posefuse.kernels.cameras.points import (
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
    linear_start,
    normal_equations,
    open_lanes,
    store_points,
    take_step,
)
from posefuse.kernels.cameras.views import (
    linear_errors,
    load_block,
    locate_lanes,
    reproject_block,
    store_view_results,
    weigh_block,
)
from posefuse.kernels.jit import inline, kernel, step
from posefuse.kernels.triangulation.pair_search import copy_pair, rank_views, search, two_view_point

_GENEROUS_ROUNDS = 2
# A rival explanation must cost more than the best by this share of what a disagreeing view costs.
_CLEAR_LEAD = 0.5
# So near there is no telling which of the two is right; they are two if they lie so many standard errors apart.
_TIE = 0.075
_APART_SQUARED = 36.0
# With more views than this some are nearly always wrong, and asking whether none is would be vain.
_QUICK_UP_TO = 8
_QUICK_ROUNDS = 4
# How a block is sought: the point of all views; a few pairs; as many as it takes.
_QUICK = 0
_BRIEF = 1
_WHOLE = 2
# Far from the algebraic point of all views a cost does not fall to a tenth in the rounds that follow.
_HOPELESS = 10.0
# Rows of the array of sums, after those of all solvers: how fast each lane's weight falls in the view at hand, and what
# that takes from the second derivatives.
_FALLING = SUM_ROWS
_BEND = SUM_ROWS + 1
# Where less of the second derivatives is left, steps are those of Gauss and Newton.
_LEAST_LEFT = 0.1


@inline
def robust_equations(rows, weights, strict, state, full, none, sums):
    """Newton's equations of the bounded cost: views within ``full`` count whole, beyond ``none`` not at all.

    Both in squared sigma units. Between them the weight falls as ``(1 - u)^2``, u from 0 to 1; the cost is its
    integral.
    """
    span = none - full
    inverse_span = 1.0 / span
    clear_sums(sums)
    for k in range(6):
        for j in range(BLOCK):
            sums[_BEND + k, j] = 0.0
    for v in range(weights.shape[0]):
        between = 0
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
            falling = 4.0 * weight * weight * inverse_span * fall if u > 0.0 else 0.0
            sums[_FALLING, j] = falling
            between += 1 if falling > 0.0 else 0
        if strict and between > 0:
            for j in range(BLOCK):
                _add_bend(rows, v, j, state, sums)
    if strict:
        _bend(sums)


@inline
def _add_bend(rows, v, j, state, sums):
    """What the second derivatives of a lane's cost lose because the weight of a view falls as it moves away."""
    depth, r, s = residual(rows, v, j, state[X, j], state[X + 1, j], state[X + 2, j])
    inverse = 1.0 / depth
    along = r * r + s * s
    q0 = inverse * (r * rows[v, 0, j] + s * rows[v, 4, j] - along * rows[v, 8, j])
    q1 = inverse * (r * rows[v, 1, j] + s * rows[v, 5, j] - along * rows[v, 9, j])
    q2 = inverse * (r * rows[v, 2, j] + s * rows[v, 6, j] - along * rows[v, 10, j])
    w0 = sums[_FALLING, j] * q0
    w1 = sums[_FALLING, j] * q1
    w2 = sums[_FALLING, j] * q2
    sums[_BEND, j] += w0 * q0
    sums[_BEND + 1, j] += w0 * q1
    sums[_BEND + 2, j] += w0 * q2
    sums[_BEND + 3, j] += w1 * q1
    sums[_BEND + 4, j] += w1 * q2
    sums[_BEND + 5, j] += w2 * q2


@inline
def _bend(sums):
    """Newton's matrix in place of Gauss and Newton's, where it is positive definite and no step grows tenfold by it.

    With falling weights left out of the derivatives, points with a view between the two bounds would come near only
    slowly, and all of a block would wait for them. The ratio of the determinants is the product of the shares that
    are left along three directions, none of which is above one.
    """
    for j in range(BLOCK):
        xx = sums[0, j] - sums[_BEND, j]
        xy = sums[1, j] - sums[_BEND + 1, j]
        xz = sums[2, j] - sums[_BEND + 2, j]
        yy = sums[3, j] - sums[_BEND + 3, j]
        yz = sums[4, j] - sums[_BEND + 4, j]
        zz = sums[5, j] - sums[_BEND + 5, j]
        whole = _determinant(sums[0, j], sums[1, j], sums[2, j], sums[3, j], sums[4, j], sums[5, j])
        left = _determinant(xx, xy, xz, yy, yz, zz)
        downhill = (xx > 0.0) & (xx * yy > xy * xy) & (left > _LEAST_LEFT * whole)
        sums[0, j] = xx if downhill else sums[0, j]
        sums[1, j] = xy if downhill else sums[1, j]
        sums[2, j] = xz if downhill else sums[2, j]
        sums[3, j] = yy if downhill else sums[3, j]
        sums[4, j] = yz if downhill else sums[4, j]
        sums[5, j] = zz if downhill else sums[5, j]


@inline
def _determinant(xx, xy, xz, yy, yz, zz):
    return xx * (yy * zz - yz * yz) - xy * (xy * zz - xz * yz) + xz * (xy * yz - xz * yy)


@inline
def refine(rows, weights, thorough, full, none, used, sums, state, lanes):
    """Points of the lanes that come in ACTIVE, from the points in ``state``.

    Args:
        rows: shape (view, 12, BLOCK).
        weights: shape (view, BLOCK).
        thorough: if so, robust points, sought first generously, then strictly; else points of all views, given up
            where those can hardly agree.
        full: a view within so many squared sigmas counts whole.
        none: beyond so many not at all.
        used: shape (BLOCK,), how many views each lane has.
        sums: shape (SUM_ROWS, BLOCK), scratch.
        state: shape (STATE_ROWS, BLOCK).
        lanes: shape (BLOCK,).
    """
    begin = 0 if thorough else _GENEROUS_ROUNDS
    end = _GENEROUS_ROUNDS + (MAX_ITERATIONS if thorough else _QUICK_ROUNDS)
    # One loop for all, so that its body is compiled once.
    for turn in range(begin, end):
        if turn == _GENEROUS_ROUNDS:
            for j in range(BLOCK):
                lanes[j] = ACTIVE if lanes[j] == OK else lanes[j]
                state[COST, j] = math.inf
                state[SCALE, j] = 1.0
        widening = 4.0 if turn < _GENEROUS_ROUNDS else 1.0
        widening = widening if thorough else 1e6
        robust_equations(rows, weights, turn >= _GENEROUS_ROUNDS, state, widening * full, widening * none, sums)
        if not thorough:
            for j in range(BLOCK):
                hopeless = not sums[TOTAL, j] < _HOPELESS * full * used[j]
                lanes[j] = SINGULAR if hopeless & (lanes[j] == ACTIVE) else lanes[j]
        active = take_step(sums, state, lanes)
        if (active == 0) & (turn >= _GENEROUS_ROUNDS):
            break
    # Weights that change with the point make the last steps slow or vain; each that was taken lowered the cost, so
    # where there is a cost there is a point.
    for j in range(BLOCK):
        stuck = (lanes[j] == ACTIVE) | (lanes[j] == BEHIND)
        lanes[j] = OK if thorough & stuck & (state[COST, j] < math.inf) else lanes[j]


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
def _start_quickly(rows, weights, min_views, sums, state, used, lanes):
    """Begin with the algebraic points of all views."""
    open_lanes(weights, min_views, lanes, used)
    linear_start(rows, weights, sums, state, lanes)
    for j in range(BLOCK):
        lanes[j] = SINGULAR if used[j] < min_views else lanes[j]


@inline
def _put_off(places, n_keypoints, j, used, pending, waiting, queue):
    """Leave lane ``j`` to be gone over again."""
    used[j] = 0
    if places[0, j] >= 0:
        pending[queue, waiting[queue]] = places[0, j] * n_keypoints + places[1, j]
        waiting[queue] += 1
        places[0, j] = -1


@inline
def _leave_contested(places, n_keypoints, min_views, brief, used, agreeing, lanes, best, pending, waiting):
    """Put off the lanes whose views do not all agree with the point of all."""
    for j in range(BLOCK):
        # No proposal was needed.
        best[4, j] = 0.0
        if used[j] >= min_views and not (lanes[j] == OK and agreeing[j] == used[j]):
            agreeing[j] = 0
            _put_off(places, n_keypoints, j, used, pending, waiting, 0 if brief > 0 else 1)


@inline
def _leave_undecided(undecided, places, n_keypoints, best, used, pending, waiting):
    """Put off the lanes, if there are any, for which more pairs than the first few have to be tried."""
    for j in range(BLOCK):
        if undecided > 0 and best[3, j] < best[6, j]:
            _put_off(places, n_keypoints, j, used, pending, waiting, np.int64(1))


@inline
def _next_block(first, total, n_views, n_keypoints, brief, pending, waiting, places):
    """What is worked on next: new points, or as soon as they fill a block, those that were put off.

    Args:
        first: number of the next new point.
        total: of new points.
        n_views: of the rig.
        n_keypoints: of a person.
        brief: how many pairs a brief search tries; 0 if all are whole.
        pending: shape (2, point), int64: numbers of the points put off to a brief search, and to a whole one.
        waiting: shape (2,), int64: how many of each there are.
        places: shape (2, BLOCK), written.

    Returns:
        How the block is to be sought, and the next new point.
    """
    fresh = first < total
    queue = 1 if waiting[1] >= BLOCK or (waiting[0] == 0 and not fresh) else 0
    if fresh and waiting[queue] < BLOCK:
        locate_lanes(first, total, n_keypoints, places)
        return _QUICK if n_views <= _QUICK_UP_TO else (_BRIEF if brief > 0 else _WHOLE), first + BLOCK
    taken = min(waiting[queue], BLOCK)
    # The last to come are the first to go: which lanes share a block changes nothing.
    waiting[queue] -= taken
    for j in range(BLOCK):
        point = pending[queue, waiting[queue] + j] if j < taken else 0
        places[0, j] = point // n_keypoints if j < taken else -1
        places[1, j] = point % n_keypoints
    return _BRIEF + queue, first


@inline
def _spread(rows, accepted, thorough, sums, state, status):
    """Covariances from what the accepted views tell, each at its full weight, into the first six rows of ``sums``."""
    # Where all views were accepted, the last step has told already.
    if thorough:
        normal_equations(rows, accepted, state, sums)
        for i in range(6):
            for j in range(BLOCK):
                state[INFORMATION + i, j] = sums[i, j]
    judge_geometry(state, sums, status)


@inline
def _mark_outliers(accepted, status, view_codes):
    """Views that were there and disagree."""
    for v in range(accepted.shape[0]):
        for j in range(BLOCK):
            rejected = (view_codes[v, j] == status_codes.VIEW_USED) & (accepted[v, j] == 0.0)
            rejected = rejected & (status[j] < status_codes.POINT_MISSING)
            view_codes[v, j] = status_codes.VIEW_OUTLIER if rejected else view_codes[v, j]


@step
def _rival(rows, weights, accepted, j, bound, pair, pair_weights):
    """The best two-view point of lane ``j`` that rests on a view which was not accepted: ``(cost, x, y, z)``."""
    n_views = weights.shape[0]
    lowest = math.inf
    best_x = math.nan
    best_y = math.nan
    best_z = math.nan
    for a in range(n_views):
        for b in range(a):
            if weights[a, j] == 0.0 or weights[b, j] == 0.0 or (accepted[a, j] > 0.0 and accepted[b, j] > 0.0):
                continue
            copy_pair(rows, weights, a, b, j, pair, pair_weights)
            found, x, y, z = two_view_point(pair, pair_weights, j)
            if found == 0.0:
                continue
            cost = 0.0
            for v in range(n_views):
                if weights[v, j] > 0.0:
                    depth, r, s = residual(rows, v, j, x, y, z)
                    squared = weights[v, j] * (r * r + s * s)
                    cost += squared if depth > 0.0 and squared < bound else bound
            if cost < lowest:
                lowest = cost
                best_x = x
                best_y = y
                best_z = z
    return lowest, best_x, best_y, best_z


@step
def _doubt(rows, weights, accepted, state, j, cost, bound, pair, pair_weights):
    """What to say of a point that hardly more views agree on than disagree: its code if it has a rival, else OK."""
    rival, x, y, z = _rival(rows, weights, accepted, j, bound, pair, pair_weights)
    if rival >= cost + _CLEAR_LEAD * bound:
        return status_codes.POINT_OK
    x -= state[X, j]
    y -= state[X + 1, j]
    z -= state[X + 2, j]
    i = INFORMATION
    apart = x * (state[i, j] * x + 2.0 * (state[i + 1, j] * y + state[i + 2, j] * z))
    apart += y * (state[i + 3, j] * y + 2.0 * state[i + 4, j] * z) + z * z * state[i + 5, j]
    tie = rival < cost + _TIE * bound and apart > _APART_SQUARED
    return status_codes.POINT_UNDECIDED if tie else status_codes.POINT_AMBIGUOUS


@inline
def _judge(rows, weights, accepted, best, bound, min_views, used, agreeing, state, lanes, pair, pair_weights, status):
    """From what came of the search to point codes."""
    for j in range(BLOCK):
        code = status_codes.POINT_OK if agreeing[j] > 2 else status_codes.POINT_TWO_VIEWS
        if used[j] < min_views:
            code = status_codes.POINT_NOT_SEEN if used[j] == 0 else status_codes.POINT_TOO_FEW_VIEWS
        elif lanes[j] == BEHIND or best[4, j] == math.inf:
            code = status_codes.POINT_BEHIND_CAMERA
        elif lanes[j] == ACTIVE:
            code = status_codes.POINT_NO_CONVERGENCE
        elif agreeing[j] < min_views:
            code = status_codes.POINT_OUTLIER
        elif lanes[j] == SINGULAR:
            code = status_codes.POINT_DEGENERATE
        elif agreeing[j] < used[j] and (agreeing[j] <= 3 or 2 * agreeing[j] <= used[j] + 1):
            code = max(code, _doubt(rows, weights, accepted, state, j, best[4, j], bound, pair, pair_weights))
        status[j] = code


@kernel
def triangulate_consensus(
    cameras,
    distorted,
    fisheye,
    keypoints_px,
    confidence,
    rows_of,
    scale_px,
    exponent,
    min_confidence,
    min_views,
    pairs,
    enough,
    brief,
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
        distorted: None if the rig has no lens with distortion polynomials.
        fisheye: None if it has no fisheye.
        keypoints_px: shape (detection, keypoint, 2), NaN where missing.
        confidence: shape (detection, keypoint), NaN where the detector gives none.
        rows_of: shape (person_frame, view), int64: rows of the two above, or NO_DETECTION or NOT_RECORDED.
        scale_px: shape (view,): the noise of a detection of confidence 1, in px per axis.
        exponent: the noise is ``scale_px / confidence^exponent``.
        min_confidence: detections below are not used.
        min_views: points with fewer agreeing views are missing (at least 2).
        pairs: shape (pair, 2), int64, see :func:`search`.
        enough: shape (view + 1, view + 1), int64, see :func:`search`.
        brief: the few points of a block for which so many pairs are not enough are put off to blocks of their own; 0
            if none are.
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
    pair, pair_weights = np.empty((2, 12, BLOCK)), np.empty((2, BLOCK))
    scratch, best = np.empty((6, BLOCK)), np.empty((7, BLOCK))
    sums = np.empty((_BEND + 6, BLOCK))
    state = np.empty((STATE_ROWS, BLOCK))
    places = np.empty((2, BLOCK), np.int64)
    used = np.empty(BLOCK, np.int64)
    agreeing = np.empty(BLOCK, np.int64)
    lanes = np.empty(BLOCK, np.int64)
    point_codes = np.empty(BLOCK, np.int64)
    bound, full, none = bound_sigma * bound_sigma, full_sigma * full_sigma, none_sigma * none_sigma
    pending, waiting = np.empty((2, total), np.int64), np.zeros(2, np.int64)
    # A plain 0 is a type of its own, and what takes it would be compiled twice.
    pending, waiting, first = np.empty((2, total), np.int64), np.zeros(2, np.int64), np.int64(0)
    while first < total or waiting[0] + waiting[1] > 0:
        sought, first = _next_block(first, total, n_views, n_keypoints, brief, pending, waiting, places)
        thorough = sought != _QUICK
        load_block(keypoints_px, confidence, rows_of, places, min_confidence, pixels, trust, block_codes)
        for v in range(n_views):
            rows_block(cameras, distorted, fisheye, v, pixels, lens_codes, rows, scratch)
        weigh_block(scale_px, exponent, trust, lens_codes, block_codes, weights)
        if thorough:
            rank_views(trust, weights, ranks, used)
            tries = brief if sought == _BRIEF else 0
            undecided = search(
                rows, weights, ranks, used, pairs, enough, tries, bound, pair, pair_weights, scratch, best
            )
            _leave_undecided(undecided, places, n_keypoints, best, used, pending, waiting)
            _start(best, min_views, used, state, lanes)
        else:
            _start_quickly(rows, weights, min_views, sums, state, used, lanes)
        refine(rows, weights, thorough, full, none, used, sums, state, lanes)
        accept(rows, weights, state, none if thorough else full, accepted, agreeing)
        if not thorough:
            _leave_contested(places, n_keypoints, min_views, brief, used, agreeing, lanes, best, pending, waiting)
        _judge(
            rows,
            weights,
            accepted,
            best,
            bound,
            min_views,
            used,
            agreeing,
            state,
            lanes,
            pair,
            pair_weights,
            point_codes,
        )
        _spread(rows, accepted, thorough, sums, state, point_codes)
        reproject_block(cameras, distorted, fisheye, pixels, state, errors)
        linear_errors(rows, accepted, state, errors)
        _mark_outliers(accepted, point_codes, block_codes)
        store_points(state, sums, point_codes, places, points, covariance, status)
        store_view_results(block_codes, errors, point_codes, places, view_codes, view_errors_px, mean_errors_px)
