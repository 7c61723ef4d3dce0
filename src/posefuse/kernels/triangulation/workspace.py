"""Parameters and scratch arrays of the consensus triangulation."""

from typing import Any, NamedTuple


class ConsensusParameters(NamedTuple):
    """Parameters of the consensus method.

    Attributes:
        min_views: points with fewer agreeing views are missing (at least 2).
        pairs: shape (pair, 2), int64: ranks of views to combine, the most promising first.
        required_tries: shape (view + 1, view + 1), int64: number of pairs after which no better point is expected, by
            number of views and number of inliers.
        early_limit: number of pairs after which the few undecided points of a block move to blocks of their own; 0 to
            disable.
        bound_sigma: hypotheses: the cost of a residual is capped at this many sigmas.
        full_sigma: refinement: a residual of fewer sigmas has full weight.
        none_sigma: refinement: a residual of more sigmas has weight 0; the view is an outlier.
    """

    min_views: int
    pairs: Any
    required_tries: Any
    early_limit: int
    bound_sigma: float
    full_sigma: float
    none_sigma: float


class Workspace(NamedTuple):
    """Arrays of one block; the last axis is the lane.

    Attributes:
        lane_indices: shape (2, BLOCK), int64: person-frame (-1: none) and keypoint of each lane.
        block_confidence: shape (view, BLOCK).
        rows: shape (view, 12, BLOCK), from :func:`posefuse.kernels.cameras.observation_rows.rows_block`.
        weights: shape (view, BLOCK), 1/px^2; 0 means unused.
        accepted: shape (view, BLOCK): the weights, 0 for outliers.
        ranks: shape (view, BLOCK), int64: views by confidence.
        n_used, n_agreeing: shape (BLOCK,), int64: number of used views, and of those that agree with the point.
        lane_status: shape (BLOCK,), int64: status of the solver.
        point_codes: shape (BLOCK,), int64.
        pair: shape (2, 12, BLOCK): rows of the two views of a hypothesis.
        pair_weights: shape (2, BLOCK).
        hypothesis: shape (6, BLOCK): point, whether it lies in front of both views, cost, number of inliers; scratch
            while rows are computed.
        best: shape (7, BLOCK): point, number of pairs tried, cost, number of inliers, number of pairs to try.
        sums: shape (SUM_ROWS, BLOCK) and the rows of :mod:`posefuse.kernels.triangulation.robust_refinement`.
        state: shape (STATE_ROWS, BLOCK): the points.
        pending: shape (2, point), int64: numbers of the points postponed to an early-stopping and to a complete search.
        n_pending: shape (2,), int64: number of points in each queue.
    """

    lane_indices: Any
    block_confidence: Any
    rows: Any
    weights: Any
    accepted: Any
    ranks: Any
    n_used: Any
    n_agreeing: Any
    lane_status: Any
    point_codes: Any
    pair: Any
    pair_weights: Any
    hypothesis: Any
    best: Any
    sums: Any
    state: Any
    pending: Any
    n_pending: Any
