"""Scratch arrays of the pair solve: one block of keypoint pairs, observations by label."""

from collections import namedtuple

import numpy as np

from posefuse.kernels.jit import kernel
from posefuse.kernels.left_right.search import MAX_GROUPS, N_CANDIDATES

Workspace = namedtuple(
    "Workspace",
    "lane_indices keypoints pixels block_confidence rows weights codes lens_codes scratch ranks n_observed "
    "any_confidence any_weights candidates candidate trial point_weights totals best labels evidence side_rows "
    "side_weights side_pixels side_errors state sums n_agreeing n_valid n_rays status",
)
"""Arrays by label (left, right) or side (left, right), view and lane:

lane_indices, keypoints: person-frame and pair of each lane; person-frame and keypoint of the label being read.
pixels, block_confidence, rows, weights, codes: of the observations, by label.
lens_codes, scratch: for reading pixels.
ranks, n_observed, any_confidence, any_weights: views by confidence, for either label.
candidates: shape (candidate, CANDIDATE_ROWS, BLOCK), refined; candidate: the chosen one; best: its index; totals: costs
including those of motion; trial, point_weights: scratch.
labels: shape (side, view, BLOCK), the label of the observation that supports each point, or -1.
evidence: cost of the view as labeled minus its cost swapped.
side_*: the observations that support a point.
state, sums: of both points, as in :mod:`posefuse.kernels.cameras.points`.
n_agreeing, n_valid, n_rays, status: views supporting each point, observations that could belong to it, observations of
the pair, point codes.
"""

SearchWorkspace = namedtuple(
    "SearchWorkspace",
    "rows weights normal observations points costs single_cost support_bits groups best_costs best_points",
)
"""Arrays of one lane, see :func:`posefuse.kernels.left_right.search.propose_lane`."""


@kernel
def make_search_workspace(n_views, n_rank_pairs):
    """Allocate the arrays for the search of one lane."""
    max_points = 4 * n_rank_pairs
    return SearchWorkspace(
        rows=np.empty((2 * n_views, 12)),
        weights=np.empty(2 * n_views),
        normal=np.empty((9, 2 * n_views)),
        observations=np.empty((2, max_points), np.int64),
        points=np.empty((3, max_points)),
        costs=np.empty((2 * n_views, max_points)),
        single_cost=np.empty(max_points),
        support_bits=np.empty(max_points, np.int64),
        groups=np.empty(MAX_GROUPS, np.int64),
        best_costs=np.empty(N_CANDIDATES),
        best_points=np.empty((2, N_CANDIDATES), np.int64),
    )
