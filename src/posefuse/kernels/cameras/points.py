"""Points from observation rows: linear start, maximum-likelihood refinement, covariance.

All of it works on the rows of :func:`posefuse.kernels.cameras.observation_rows.rows_block`: per view ``g0, g1, c`` with residual
``(g0.X, g1.X) / c.X`` in true pixels and depth ``c.X``. A view's weight is ``1 / sigma^2`` in 1/px^2; weight 0 leaves
it out. Symmetric 3x3 matrices travel as six numbers: xx, xy, xz, yy, yz, zz.

Points are worked through in blocks of ``BLOCK`` lanes, the lane as the last axis of every array, so that the loops
over lanes become vector instructions.
"""

import math

import numpy as np

from posefuse.kernels import status_codes
from posefuse.kernels.cameras.observation_rows import BLOCK, residual, rows_block
from posefuse.kernels.cameras.views import (
    linear_errors,
    load_block,
    locate_lanes,
    reproject_block,
    store_view_results,
    weigh_block,
)
from posefuse.kernels.jit import inline, kernel

OK = 0
SINGULAR = 1
"""The rays do not fix a point: fewer than two, parallel, or from one centre."""
BEHIND = 2
"""The point lies behind a camera that is said to see it."""
NO_CONVERGENCE = 3
ACTIVE = 4
"""Not finished: another step is needed."""

# Rows of the state array, a column a lane.
X = 0
COST = 3
"""Sum of squared residuals in sigma units."""
SCALE = 4
"""How much of the last step was taken; halved where the step failed."""
STEP = 5
INFORMATION = 8
"""Six numbers: the inverse of the covariance."""
STATE_ROWS = 14

# Rows of the array of sums over views.
_GRADIENT = 6
TOTAL = 9
"""The cost."""
DEPTH = 10
"""The smallest depth over the used views."""
SUM_ROWS = 11

MAX_ITERATIONS = 30
# Stop after a step of a hundredth of the point's own standard error: convergence is better than tenfold a step, so
# what remains is far below it.
_SMALL_STEP = 1e-4
# Smallest admissible pivot relative to the diagonal before elimination: rays within some 1e-7 rad are parallel.
_SINGULAR_PIVOT = 1e-14
# Nor is it worth going on once the step is lost in the rounding of coordinates.
_SMALLEST_STEP_SQUARED = 1e-20
# A point is badly known where its standard deviation is more than this share of its distance from a camera, and not
# known at all past the second: then the rays are parallel as far as the noise lets one tell.
_WEAK_SHARE = 0.1
_DEGENERATE_SHARE = 0.25


@inline
def solve_symmetric(xx, xy, xz, yy, yz, zz, bx, by, bz):
    """Solve a symmetric positive definite 3x3 system.

    Returns:
        ``(ok, x, y, z)``; not ok where a pivot vanishes against its diagonal, the numbers are then meaningless.
    """
    w0 = 1.0 / xx
    l1 = xy * w0
    l2 = xz * w0
    d1 = yy - l1 * xy
    w1 = 1.0 / d1
    e = yz - l1 * xz
    l3 = e * w1
    d2 = zz - l2 * xz - l3 * e
    y1 = by - l1 * bx
    z = (bz - l2 * bx - l3 * y1) / d2
    y = y1 * w1 - l3 * z
    x = bx * w0 - l1 * y - l2 * z
    return (xx > 0.0) & (d1 > _SINGULAR_PIVOT * yy) & (d2 > _SINGULAR_PIVOT * zz), x, y, z


@inline
def invert_symmetric(xx, xy, xz, yy, yz, zz):
    """The inverse of a symmetric positive definite 3x3 matrix, ``(ok, xx, xy, xz, yy, yz, zz)``."""
    w0 = 1.0 / xx
    l1 = xy * w0
    l2 = xz * w0
    d1 = yy - l1 * xy
    w1 = 1.0 / d1
    e = yz - l1 * xz
    l3 = e * w1
    d2 = zz - l2 * xz - l3 * e
    w2 = 1.0 / d2
    # With A = L D L^T the inverse is M^T D^-1 M, M = L^-1 = [[1, 0, 0], [-l1, 1, 0], [m, -l3, 1]].
    m = l1 * l3 - l2
    return (
        (xx > 0.0) & (d1 > _SINGULAR_PIVOT * yy) & (d2 > _SINGULAR_PIVOT * zz),
        w0 + l1 * l1 * w1 + m * m * w2,
        -l1 * w1 - m * l3 * w2,
        m * w2,
        w1 + l3 * l3 * w2,
        -l3 * w2,
        w2,
    )


@inline
def clear_sums(sums):
    """Start sums over views."""
    for k in range(SUM_ROWS):
        for j in range(BLOCK):
            sums[k, j] = 0.0
    for j in range(BLOCK):
        sums[DEPTH, j] = math.inf


@inline
def _add_equations(a0, a1, a2, b0, b1, b2, r, s, w, j, sums):
    """Add two residuals of weight ``w``, whose derivatives are a and b, to the normal equations of a lane."""
    wa0 = w * a0
    wa1 = w * a1
    wa2 = w * a2
    wb0 = w * b0
    wb1 = w * b1
    wb2 = w * b2
    sums[0, j] += wa0 * a0 + wb0 * b0
    sums[1, j] += wa0 * a1 + wb0 * b1
    sums[2, j] += wa0 * a2 + wb0 * b2
    sums[3, j] += wa1 * a1 + wb1 * b1
    sums[4, j] += wa1 * a2 + wb1 * b2
    sums[5, j] += wa2 * a2 + wb2 * b2
    sums[6, j] += wa0 * r + wb0 * s
    sums[7, j] += wa1 * r + wb1 * s
    sums[8, j] += wa2 * r + wb2 * s


@inline
def linear_start(rows, weights, sums, state, lanes):
    """Start active lanes where the depth-weighted (algebraic) residuals are least."""
    clear_sums(sums)
    for v in range(weights.shape[0]):
        for j in range(BLOCK):
            _add_equations(
                rows[v, 0, j],
                rows[v, 1, j],
                rows[v, 2, j],
                rows[v, 4, j],
                rows[v, 5, j],
                rows[v, 6, j],
                rows[v, 3, j],
                rows[v, 7, j],
                weights[v, j],
                j,
                sums,
            )
    for j in range(BLOCK):
        solved, x, y, z = solve_symmetric(
            sums[0, j], sums[1, j], sums[2, j], sums[3, j], sums[4, j], sums[5, j], sums[6, j], sums[7, j], sums[8, j]
        )
        state[X, j] = -x
        state[X + 1, j] = -y
        state[X + 2, j] = -z
        state[COST, j] = math.inf
        state[SCALE, j] = 1.0
        lanes[j] = SINGULAR if (lanes[j] == ACTIVE) & (not solved) else lanes[j]


@inline
def add_view(rows, v, j, depth, r, s, w, sums):
    """Add a view of weight ``w`` (1/px^2) to the sums of its lane, all but the cost."""
    inverse = 1.0 / depth
    c0 = inverse * rows[v, 8, j]
    c1 = inverse * rows[v, 9, j]
    c2 = inverse * rows[v, 10, j]
    _add_equations(
        inverse * rows[v, 0, j] - r * c0,
        inverse * rows[v, 1, j] - r * c1,
        inverse * rows[v, 2, j] - r * c2,
        inverse * rows[v, 4, j] - s * c0,
        inverse * rows[v, 5, j] - s * c1,
        inverse * rows[v, 6, j] - s * c2,
        r,
        s,
        w,
        j,
        sums,
    )
    sums[DEPTH, j] = min(sums[DEPTH, j], depth if w > 0.0 else math.inf)


@inline
def normal_equations(rows, weights, state, sums):
    """Gauss-Newton normal equations of the weighted reprojection error at each lane's point.

    ``sums`` receives the information matrix, the gradient, the cost, and the smallest depth over used views.
    """
    clear_sums(sums)
    for v in range(weights.shape[0]):
        for j in range(BLOCK):
            depth, r, s = residual(rows, v, j, state[X, j], state[X + 1, j], state[X + 2, j])
            add_view(rows, v, j, depth, r, s, weights[v, j], sums)
            sums[TOTAL, j] += weights[v, j] * (r * r + s * s)


@inline
def take_step(sums, state, lanes):
    """One damped Gauss-Newton step of every active lane, from the sums at its point; steps take the gradients' place.

    A step that put the point behind a used view, or raised the cost, is halved instead. No branches: they would keep
    the compiler from using vector instructions.

    Returns:
        How many lanes are still active.
    """
    for j in range(BLOCK):
        gx = sums[_GRADIENT, j]
        gy = sums[_GRADIENT + 1, j]
        gz = sums[_GRADIENT + 2, j]
        solved, sx, sy, sz = solve_symmetric(
            sums[0, j], sums[1, j], sums[2, j], sums[3, j], sums[4, j], sums[5, j], gx, gy, gz
        )
        sums[_GRADIENT, j] = sx
        sums[_GRADIENT + 1, j] = sy
        sums[_GRADIENT + 2, j] = sz
        # The product of step and gradient is the squared step in units of the point's standard error.
        step_squared = sx * sx + sy * sy + sz * sz
        depth = sums[DEPTH, j]
        small = (gx * sx + gy * sy + gz * sz < _SMALL_STEP) | (step_squared < _SMALLEST_STEP_SQUARED * depth * depth)
        cost = sums[TOTAL, j]
        best = state[COST, j]
        better = (depth > 0.0) & (cost <= best * (1.0 + 1e-12))
        scale = 1.0 if better else 0.5 * state[SCALE, j]
        hopeless = (best == math.inf) | (scale < 1e-9)
        failed = hopeless if not better else not solved
        active = lanes[j] == ACTIVE
        go = active & (not failed)
        advance = go & better
        for k in range(3):
            step = sums[_GRADIENT + k, j]
            state[X + k, j] -= (step if better else -scale * state[STEP + k, j]) if go else 0.0
            state[STEP + k, j] = step if advance else state[STEP + k, j]
        state[SCALE, j] = scale if go else state[SCALE, j]
        state[COST, j] = cost if advance else best
        for k in range(6):
            state[INFORMATION + k, j] = sums[k, j] if advance else state[INFORMATION + k, j]
        code = BEHIND if not better else SINGULAR
        code = code if failed else (OK if better & small else ACTIVE)
        lanes[j] = code if active else lanes[j]
    active_lanes = 0
    for j in range(BLOCK):
        active_lanes += 1 if lanes[j] == ACTIVE else 0
    return active_lanes


@inline
def solve_block(rows, weights, sums, state, lanes):
    """Maximum-likelihood points of a block.

    Args:
        rows: shape (view, 12, BLOCK).
        weights: shape (view, BLOCK).
        sums: shape (SUM_ROWS, BLOCK), scratch.
        state: shape (STATE_ROWS, BLOCK), written: position, cost, information matrix.
        lanes: shape (BLOCK,), in and out: lanes that come in ACTIVE are solved, the others left alone.
    """
    linear_start(rows, weights, sums, state, lanes)
    for _ in range(MAX_ITERATIONS):
        normal_equations(rows, weights, state, sums)
        if take_step(sums, state, lanes) == 0:
            return
    for j in range(BLOCK):
        lanes[j] = NO_CONVERGENCE if lanes[j] == ACTIVE else lanes[j]


@inline
def open_lanes(weights, min_views, lanes, used):
    """Count each lane's views; lanes with enough become ACTIVE, the others get their point code at once."""
    for j in range(BLOCK):
        used[j] = 0
    for v in range(weights.shape[0]):
        for j in range(BLOCK):
            used[j] += 1 if weights[v, j] > 0.0 else 0
    for j in range(BLOCK):
        lanes[j] = ACTIVE if used[j] >= min_views else OK


@inline
def _point_codes(lanes, used, min_views, status):
    """From solver status and number of views to the point code."""
    for j in range(BLOCK):
        code = status_codes.POINT_OK if used[j] > 2 else status_codes.POINT_TWO_VIEWS
        if used[j] < min_views:
            code = status_codes.POINT_NOT_SEEN if used[j] == 0 else status_codes.POINT_TOO_FEW_VIEWS
        elif lanes[j] == SINGULAR:
            code = status_codes.POINT_DEGENERATE
        elif lanes[j] == BEHIND:
            code = status_codes.POINT_BEHIND_CAMERA
        elif lanes[j] == NO_CONVERGENCE:
            code = status_codes.POINT_NO_CONVERGENCE
        status[j] = code


@inline
def judge_geometry(state, sums, status):
    """Turn the information of a block into covariances, and see whether the rays say how far away the points are.

    ``sums``, of the last step, receives the covariances in its first six rows.
    """
    for j in range(BLOCK):
        depth = sums[DEPTH, j]
        regular, xx, xy, xz, yy, yz, zz = invert_symmetric(
            state[INFORMATION, j],
            state[INFORMATION + 1, j],
            state[INFORMATION + 2, j],
            state[INFORMATION + 3, j],
            state[INFORMATION + 4, j],
            state[INFORMATION + 5, j],
        )
        sums[0, j] = xx
        sums[1, j] = xy
        sums[2, j] = xz
        sums[3, j] = yy
        sums[4, j] = yz
        sums[5, j] = zz
        spread = xx + yy + zz
        code = status[j]
        weak = spread > _WEAK_SHARE * _WEAK_SHARE * depth * depth
        lost = (spread > _DEGENERATE_SHARE * _DEGENERATE_SHARE * depth * depth) | (not regular)
        judged = (
            status_codes.POINT_DEGENERATE if lost else (max(code, status_codes.POINT_WEAK_GEOMETRY) if weak else code)
        )
        status[j] = judged if code < status_codes.POINT_MISSING else code


@inline
def store_points(state, covariances, status, places, points, covariance, out_status):
    """Write positions and covariances of a block; NaN where the status says missing."""
    for j in range(BLOCK):
        n = places[0, j]
        k = places[1, j]
        if n < 0:
            continue
        out_status[n, k] = status[j]
        if status[j] >= status_codes.POINT_MISSING:
            for i in range(3):
                points[n, k, i] = math.nan
            for i in range(6):
                covariance[n, k, i] = math.nan
            continue
        for i in range(3):
            points[n, k, i] = state[X + i, j]
        for i in range(6):
            covariance[n, k, i] = covariances[i, j]


@kernel
def triangulate_views(
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
    points,
    covariance,
    status,
    view_codes,
    view_errors_px,
    mean_errors_px,
):
    """Maximum-likelihood points from every valid view, nothing rejected.

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
        min_views: points with fewer valid views are not solved (at least 2).
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
    errors = np.empty((n_views, BLOCK))
    lens_codes = np.empty((n_views, BLOCK), np.int64)
    block_codes = np.empty((n_views, BLOCK), np.int64)
    scratch = np.empty((6, BLOCK))
    sums = np.empty((SUM_ROWS, BLOCK))
    state = np.empty((STATE_ROWS, BLOCK))
    places = np.empty((2, BLOCK), np.int64)
    used = np.empty(BLOCK, np.int64)
    lanes = np.empty(BLOCK, np.int64)
    point_codes = np.empty(BLOCK, np.int64)
    for first in range(0, total, BLOCK):
        locate_lanes(first, total, n_keypoints, places)
        load_block(keypoints_px, confidence, rows_of, places, min_confidence, pixels, trust, block_codes)
        for v in range(n_views):
            rows_block(cameras, distorted, fisheye, v, pixels, lens_codes, rows, scratch)
        weigh_block(scale_px, exponent, trust, lens_codes, block_codes, weights)
        open_lanes(weights, min_views, lanes, used)
        solve_block(rows, weights, sums, state, lanes)
        _point_codes(lanes, used, min_views, point_codes)
        judge_geometry(state, sums, point_codes)
        reproject_block(cameras, distorted, fisheye, pixels, state, errors)
        linear_errors(rows, weights, state, errors)
        store_points(state, sums, point_codes, places, points, covariance, status)
        store_view_results(block_codes, errors, point_codes, places, view_codes, view_errors_px, mean_errors_px)
