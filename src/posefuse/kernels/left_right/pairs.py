"""Two-point solve of keypoint pairs whose labels are uncertain: all candidates are scored, the best ones refined.

It works on blocks of observation rows like :mod:`posefuse.kernels.triangulation.consensus`. See
docs/methods/left_right.md.
"""

import math

import numpy as np

from posefuse.kernels.cameras.observation_blocks import (
    compute_weights,
    fill_linearized_errors,
    index_lanes,
    load_block,
    reproject_block,
)
from posefuse.kernels.cameras.observation_rows import BLOCK, rows_block
from posefuse.kernels.cameras.points import STATE_ROWS, SUM_ROWS, judge_geometry, normal_equations, store_points
from posefuse.kernels.jit import inline, kernel, subroutine
from posefuse.kernels.left_right.branch_and_bound import MAX_VIEWS, improve_lane, make_branch_workspace
from posefuse.kernels.left_right.refine import CANDIDATE_COST, CANDIDATE_ROWS, LAST_STEP, refine_candidate
from posefuse.kernels.left_right.results import (
    assign_side_codes,
    assign_views,
    gather_side,
    keep_information,
    order_points,
    store_side_results,
    store_view_outcomes,
)
from posefuse.kernels.left_right.search import N_CANDIDATES, propose_lane
from posefuse.kernels.left_right.selection import choose_candidate, flag_rivals
from posefuse.kernels.left_right.workspace import Workspace, make_search_workspace
from posefuse.kernels.triangulation.pair_search import rank_views

_WIDE_ITERATIONS = 2
_ROUGH_ITERATIONS = 5
_MAX_ITERATIONS = 60
_CONVERGED = 1e-2


@inline
def _load(cameras, observations, noise, pairs, workspace):
    """Read both observations of every lane, and rank the views by the confidence of either."""
    keypoints_px, confidence, detection_rows = observations
    scale_px, exponent, min_confidence = noise
    for label in range(2):
        for j in range(BLOCK):
            workspace.keypoints[0, j] = workspace.lane_indices[0, j]
            workspace.keypoints[1, j] = pairs[workspace.lane_indices[1, j], label]
        pixels, block_confidence, view_codes = (
            workspace.pixels[label],
            workspace.block_confidence[label],
            workspace.codes[label],
        )
        load_block(
            keypoints_px,
            confidence,
            detection_rows,
            workspace.keypoints,
            min_confidence,
            pixels,
            block_confidence,
            view_codes,
        )
        for v in range(cameras.shape[0]):
            rows_block(cameras, v, pixels, workspace.lens_codes, workspace.rows[label], workspace.scratch)
        compute_weights(
            scale_px, exponent, block_confidence, workspace.lens_codes, view_codes, workspace.weights[label]
        )
    for v in range(cameras.shape[0]):
        for j in range(BLOCK):
            left = workspace.weights[0, v, j] > 0.0
            right = workspace.weights[1, v, j] > 0.0
            workspace.any_weights[v, j] = 1.0 if left | right else 0.0
            workspace.any_confidence[v, j] = (workspace.block_confidence[0, v, j] if left else 0.0) + (
                workspace.block_confidence[1, v, j] if right else 0.0
            )
    rank_views(workspace.any_confidence, workspace.any_weights, workspace.ranks, workspace.n_observed)


@inline
def _propose(rank_pairs, full, none, workspace, search_workspace):
    """Search every lane for the cheapest candidates of two-ray points."""
    for j in range(BLOCK):
        if workspace.lane_indices[0, j] >= 0:
            propose_lane(workspace, rank_pairs, full, none, j, search_workspace)
        else:
            for i in range(N_CANDIDATES):
                for axis in range(6):
                    workspace.candidates[i, axis, j] = math.nan


@inline
def _empty(candidate):
    """Return whether no lane has this candidate."""
    lanes = 0
    for j in range(BLOCK):
        lanes += 1 if candidate[0, j] == candidate[0, j] else 0
    return lanes == 0


@subroutine
def _search_exhaustively(workspace, full, none, branch_workspace):
    """Where views are few, add as last candidate one that is cheaper than all others, if there is any."""
    weights, n_observed, candidates = workspace.weights, workspace.n_observed, workspace.candidates
    bound = full + (none - full) * (1.0 / 3.0)
    improved = candidates[N_CANDIDATES]
    for j in range(BLOCK):
        few_views = 2 <= n_observed[j] <= MAX_VIEWS
        for i in range(6):
            improved[i, j] = candidates[0, i, j] if few_views else math.nan
        if not few_views:
            continue
        cost = math.inf
        for candidate in candidates[:N_CANDIDATES]:
            # The cost of a candidate that has not converged is unreliable: it may be about to lose a point.
            if not candidate[LAST_STEP, j] < _CONVERGED:
                candidate[CANDIDATE_COST, j] = math.inf
            elif candidate[CANDIDATE_COST, j] < cost:
                cost = candidate[CANDIDATE_COST, j]
                for i in range(6):
                    improved[i, j] = candidate[i, j]
        for v in range(weights.shape[1]):
            cost -= 0.0 if weights[0, v, j] > 0.0 else bound
            cost -= 0.0 if weights[1, v, j] > 0.0 else bound
        improve_lane(workspace, full, none, improved, cost, j, branch_workspace)


@inline
def _refine(full, none, prior_sigma, previous, workspace, branch_workspace):
    """Refine the candidates roughly over all views, choose the cheapest, and refine it until convergence."""
    bound = full + (none - full) * (1.0 / 3.0)
    # A single loop covers all phases, so that its body is compiled once.
    for i in range(N_CANDIDATES + 2):
        if i < N_CANDIDATES:
            first_iteration = 0
            candidate, last_iteration = (
                workspace.candidates[i],
                1 if _empty(workspace.candidates[i]) else _WIDE_ITERATIONS + _ROUGH_ITERATIONS,
            )
        elif i == N_CANDIDATES:
            _search_exhaustively(workspace, full, none, branch_workspace)
            candidate, first_iteration = workspace.candidates[i], _WIDE_ITERATIONS
            last_iteration = _WIDE_ITERATIONS if _empty(candidate) else _WIDE_ITERATIONS + _ROUGH_ITERATIONS
        else:
            choose_candidate(
                workspace.candidates,
                workspace.lane_indices,
                prior_sigma,
                bound,
                previous,
                workspace.totals,
                workspace.best,
                workspace.candidate,
            )
            candidate, first_iteration, last_iteration = workspace.candidate, _WIDE_ITERATIONS, _MAX_ITERATIONS
        refine_candidate(workspace, candidate, first_iteration, last_iteration, full, none)


@inline
def _use_given_points(given_points, workspace):
    """Use points from another method, without rivals."""
    for j in range(BLOCK):
        n = workspace.lane_indices[0, j]
        k = workspace.lane_indices[1, j]
        workspace.best[j] = 0
        workspace.candidate[CANDIDATE_COST, j] = 0.0
        workspace.candidate[LAST_STEP, j] = 0.0
        for axis in range(6):
            workspace.candidate[axis, j] = given_points[n, k, axis] if n >= 0 else math.nan
            for i in range(N_CANDIDATES + 1):
                workspace.candidates[i, axis, j] = math.nan
        for i in range(N_CANDIDATES + 1):
            workspace.totals[i, j] = 0.0


@inline
def _finish_side(cameras, workspace, side, bound, min_views):
    """Compute status, covariance and errors of one point of each lane."""
    gather_side(workspace, side)
    assign_side_codes(workspace, side, _CONVERGED, min_views)
    normal_equations(workspace.side_rows, workspace.side_weights, workspace.state, workspace.sums[0])
    keep_information(workspace.sums[0], workspace.state)
    flag_rivals(
        workspace.candidates,
        workspace.totals,
        workspace.best,
        workspace.candidate,
        side,
        workspace.state,
        bound,
        workspace.status,
    )
    judge_geometry(workspace.state, workspace.sums[0], workspace.status)
    reproject_block(cameras, workspace.side_pixels, workspace.state, workspace.side_errors)
    fill_linearized_errors(workspace.side_rows, workspace.side_weights, workspace.state, workspace.side_errors)


@kernel
def solve_pairs(cameras, observations, noise, parameters, previous, given_points, out):
    """Solve for two points of every pair of keypoints; the labels of observations only determine their order.

    Args:
        cameras: the camera array.
        observations: Observations.
        noise: NoiseParameters.
        parameters: PairParameters.
        previous: shape (person, pair, 6), in and out: the points of the previous frame; NaN where missing.
        given_points: shape (person_frame, pair, 6): points to use as they are; with no person_frame, they are
            estimated.
        out: PairPoints, written.
    """
    pairs, rank_pairs, min_views, prior_sigma = (
        parameters.pairs,
        parameters.rank_pairs,
        parameters.min_views,
        parameters.prior_sigma,
    )
    n_pairs = pairs.shape[0]
    total = observations.detection_rows.shape[0] * n_pairs
    n_views = cameras.shape[0]
    # Allocate here: the compiler must know the length of the last axis to use vector instructions.
    workspace = Workspace(
        lane_indices=np.empty((2, BLOCK), np.int64),
        keypoints=np.empty((2, BLOCK), np.int64),
        pixels=np.empty((2, n_views, 2, BLOCK)),
        block_confidence=np.empty((2, n_views, BLOCK)),
        rows=np.empty((2, n_views, 12, BLOCK)),
        weights=np.empty((2, n_views, BLOCK)),
        codes=np.empty((2, n_views, BLOCK), np.int64),
        lens_codes=np.empty((n_views, BLOCK), np.int64),
        scratch=np.empty((6, BLOCK)),
        ranks=np.empty((n_views, BLOCK), np.int64),
        n_observed=np.empty(BLOCK, np.int64),
        any_confidence=np.empty((n_views, BLOCK)),
        any_weights=np.empty((n_views, BLOCK)),
        candidates=np.empty((N_CANDIDATES + 1, CANDIDATE_ROWS, BLOCK)),
        candidate=np.empty((CANDIDATE_ROWS, BLOCK)),
        trial=np.empty((CANDIDATE_ROWS, BLOCK)),
        point_weights=np.empty((4, BLOCK)),
        totals=np.empty((N_CANDIDATES + 1, BLOCK)),
        best=np.empty(BLOCK, np.int64),
        labels=np.empty((2, n_views, BLOCK), np.int64),
        evidence=np.empty((n_views, BLOCK)),
        side_rows=np.empty((n_views, 12, BLOCK)),
        side_weights=np.empty((n_views, BLOCK)),
        side_pixels=np.empty((n_views, 2, BLOCK)),
        side_errors=np.empty((n_views, BLOCK)),
        state=np.empty((STATE_ROWS, BLOCK)),
        sums=np.empty((2, SUM_ROWS, BLOCK)),
        n_agreeing=np.empty(BLOCK, np.int64),
        n_valid=np.empty(BLOCK, np.int64),
        n_rays=np.empty(BLOCK, np.int64),
        status=np.empty(BLOCK, np.int64),
    )
    search_workspace = make_search_workspace(n_views, rank_pairs.shape[0])
    branch_workspace = make_branch_workspace()
    full = parameters.full_sigma * parameters.full_sigma
    none = parameters.none_sigma * parameters.none_sigma
    bound = full + (none - full) / 3.0
    for first in range(0, total, BLOCK):
        index_lanes(first, total, n_pairs, workspace.lane_indices)
        _load(cameras, observations, noise, pairs, workspace)
        if given_points.shape[0] > 0:
            _use_given_points(given_points, workspace)
        else:
            _propose(rank_pairs, full, none, workspace, search_workspace)
            _refine(full, none, prior_sigma, previous, workspace, branch_workspace)
        assign_views(
            workspace.rows, workspace.weights, full, none, workspace.candidate, workspace.labels, workspace.evidence
        )
        order_points(workspace.block_confidence, workspace.candidate, workspace.labels, workspace.evidence)
        for side in range(2):
            _finish_side(cameras, workspace, side, bound, min_views)
            side_points, side_status = out.points[:, :, side], out.status[:, :, side]
            store_points(
                workspace.state,
                workspace.sums[0],
                workspace.status,
                workspace.lane_indices,
                side_points,
                out.covariance[:, :, side],
                side_status,
            )
            store_side_results(workspace, side, out)
        store_view_outcomes(workspace, bound, out)
