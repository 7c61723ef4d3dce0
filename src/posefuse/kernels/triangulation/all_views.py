"""Maximum-likelihood triangulation from all valid views, without outlier rejection."""

import numpy as np

from posefuse.kernels import status_codes
from posefuse.kernels.cameras.observation_blocks import (
    compute_weights,
    fill_linearized_errors,
    index_lanes,
    load_block,
    reproject_block,
    store_view_results,
)
from posefuse.kernels.cameras.observation_rows import BLOCK, rows_block
from posefuse.kernels.cameras.points import (
    BEHIND,
    NO_CONVERGENCE,
    SINGULAR,
    STATE_ROWS,
    SUM_ROWS,
    judge_geometry,
    open_lanes,
    solve_block,
    store_points,
)
from posefuse.kernels.jit import inline, kernel


@inline
def _point_codes(lane_status, n_used, min_views, status):
    """Convert solver status and number of views to point codes."""
    for j in range(BLOCK):
        code = status_codes.POINT_OK if n_used[j] > 2 else status_codes.POINT_TWO_VIEWS
        if n_used[j] < min_views:
            code = status_codes.POINT_NOT_SEEN if n_used[j] == 0 else status_codes.POINT_TOO_FEW_VIEWS
        elif lane_status[j] == SINGULAR:
            code = status_codes.POINT_DEGENERATE
        elif lane_status[j] == BEHIND:
            code = status_codes.POINT_BEHIND_CAMERA
        elif lane_status[j] == NO_CONVERGENCE:
            code = status_codes.POINT_NO_CONVERGENCE
        status[j] = code


@kernel
def triangulate_views(cameras, observations, noise, min_views, out):
    """Triangulate maximum-likelihood points from all valid views, without outlier rejection.

    Args:
        cameras: the camera array.
        observations: Observations.
        noise: NoiseParameters.
        min_views: points with fewer valid views are not solved (at least 2).
        out: TriangulatedPoints, written.
    """
    keypoints_px, confidence, detection_rows = observations
    scale_px, exponent, min_confidence = noise
    n_views = cameras.shape[0]
    n_keypoints = keypoints_px.shape[1]
    total = detection_rows.shape[0] * n_keypoints
    pixels = np.empty((n_views, 2, BLOCK))
    block_confidence = np.empty((n_views, BLOCK))
    rows = np.empty((n_views, 12, BLOCK))
    weights = np.empty((n_views, BLOCK))
    errors = np.empty((n_views, BLOCK))
    lens_codes = np.empty((n_views, BLOCK), np.int64)
    block_codes = np.empty((n_views, BLOCK), np.int64)
    scratch = np.empty((6, BLOCK))
    sums = np.empty((SUM_ROWS, BLOCK))
    state = np.empty((STATE_ROWS, BLOCK))
    lane_indices = np.empty((2, BLOCK), np.int64)
    n_used = np.empty(BLOCK, np.int64)
    lane_status = np.empty(BLOCK, np.int64)
    point_codes = np.empty(BLOCK, np.int64)
    # Read fields before the loop: each access to an array of a record counts references.
    points, covariance, status = out.points, out.covariance, out.status
    for first in range(0, total, BLOCK):
        index_lanes(first, total, n_keypoints, lane_indices)
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
            rows_block(cameras, v, pixels, lens_codes, rows, scratch)
        compute_weights(scale_px, exponent, block_confidence, lens_codes, block_codes, weights)
        open_lanes(weights, min_views, lane_status, n_used)
        solve_block(rows, weights, sums, state, lane_status)
        _point_codes(lane_status, n_used, min_views, point_codes)
        judge_geometry(state, sums, point_codes)
        reproject_block(cameras, pixels, state, errors)
        fill_linearized_errors(rows, weights, state, errors)
        store_points(state, sums, point_codes, lane_indices, points, covariance, status)
        store_view_results(block_codes, errors, point_codes, lane_indices, out)
