"""Two-view hypotheses: views ranked by confidence, pairs of them, and the pair whose point has the most support."""

import math

from posefuse.kernels.cameras.observation_rows import BLOCK, residual
from posefuse.kernels.jit import inline
from posefuse.kernels.linear_algebra.symmetric_3x3 import solve_symmetric

# A block may leave at most this many lanes undecided; beyond that it continues, because most lanes need it.
_MAX_UNDECIDED = BLOCK // 4


@inline
def rank_views(block_confidence, weights, ranks, n_used):
    """Rank the views of each lane by confidence, best first; unused views come last.

    Args:
        block_confidence: shape (view, BLOCK).
        weights: shape (view, BLOCK); 0 means unused.
        ranks: shape (view, BLOCK), int64, written: the view of each rank.
        n_used: shape (BLOCK,), int64, written: number of used views.
    """
    n_views = weights.shape[0]
    for j in range(BLOCK):
        count = 0
        for v in range(n_views):
            if weights[v, j] > 0.0:
                position = count
                while position > 0 and block_confidence[ranks[position - 1, j], j] < block_confidence[v, j]:
                    ranks[position, j] = ranks[position - 1, j]
                    position -= 1
                ranks[position, j] = v
                count += 1
        n_used[j] = count
        for position in range(count, n_views):
            ranks[position, j] = 0


@inline
def gather_pair(rows, weights, a, b, j, pair, pair_weights):
    """Copy rows and weights of views ``a`` and ``b`` of a lane side by side, to process all lanes at once."""
    pair_weights[0, j] = weights[a, j]
    pair_weights[1, j] = weights[b, j]
    for i in range(12):
        pair[0, i, j] = rows[a, i, j]
        pair[1, i, j] = rows[b, i, j]


@inline
def two_view_point(pair, pair_weights, j):
    """Triangulate the algebraic point of the pair in lane ``j``.

    Returns:
        ``(found, x, y, z)``; found is 1.0 if the point lies in front of both views, else 0.0.
    """
    u = pair_weights[0, j]
    w = pair_weights[1, j]
    g0 = pair[0, 0, j]
    g1 = pair[0, 1, j]
    g2 = pair[0, 2, j]
    g3 = pair[0, 3, j]
    h0 = pair[0, 4, j]
    h1 = pair[0, 5, j]
    h2 = pair[0, 6, j]
    h3 = pair[0, 7, j]
    k0 = pair[1, 0, j]
    k1 = pair[1, 1, j]
    k2 = pair[1, 2, j]
    k3 = pair[1, 3, j]
    l0 = pair[1, 4, j]
    l1 = pair[1, 5, j]
    l2 = pair[1, 6, j]
    l3 = pair[1, 7, j]
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
    depth_a = pair[0, 8, j] * x + pair[0, 9, j] * y + pair[0, 10, j] * z + pair[0, 11, j]
    depth_b = pair[1, 8, j] * x + pair[1, 9, j] * y + pair[1, 10, j] * z + pair[1, 11, j]
    return 1.0 if solved & (depth_a > 0.0) & (depth_b > 0.0) else 0.0, x, y, z


@inline
def _score(rows, weights, bound, hypothesis):
    """Score a hypothesis: the sum of squared residuals in sigmas, each at most ``bound``, and the inlier count.

    The results go to rows 4 and 5 of ``hypothesis``.
    """
    for j in range(BLOCK):
        hypothesis[4, j] = 0.0
        hypothesis[5, j] = 0.0
    for v in range(weights.shape[0]):
        for j in range(BLOCK):
            w = weights[v, j]
            depth, r, s = residual(rows, v, j, hypothesis[0, j], hypothesis[1, j], hypothesis[2, j])
            squared = w * (r * r + s * s)
            inlier = (squared < bound) & (depth > 0.0)
            hypothesis[4, j] += squared if inlier else (bound if w > 0.0 else 0.0)
            hypothesis[5, j] += 1.0 if inlier & (w > 0.0) else 0.0


@inline
def search_pairs(workspace, parameters, early_limit, bound):
    """Find the two-view point with the best score in each lane.

    Args:
        workspace: a Workspace; ``best`` is written.
        parameters: ConsensusParameters.
        early_limit: after this many pairs the search may stop with a few lanes undecided; 0 to disable.
        bound: cost of an outlier view, in squared sigmas.

    Returns:
        Number of undecided lanes, for which more pairs should be tried.
    """
    rows, weights, ranks, n_used = workspace.rows, workspace.weights, workspace.ranks, workspace.n_used
    pair, pair_weights = workspace.pair, workspace.pair_weights
    hypothesis, best = workspace.hypothesis, workspace.best
    pairs, required_tries = parameters.pairs, parameters.required_tries
    for j in range(BLOCK):
        best[3, j] = 0.0
        best[4, j] = math.inf
        best[5, j] = 0.0
        best[6, j] = required_tries[n_used[j], 0]
    for p in range(pairs.shape[0]):
        first = pairs[p, 0]
        second = pairs[p, 1]
        for j in range(BLOCK):
            gather_pair(rows, weights, ranks[first, j], ranks[second, j], j, pair, pair_weights)
        for j in range(BLOCK):
            hypothesis[3, j], hypothesis[0, j], hypothesis[1, j], hypothesis[2, j] = two_view_point(
                pair, pair_weights, j
            )
        _score(rows, weights, bound, hypothesis)
        for j in range(BLOCK):
            # A lane that has tried enough pairs ignores those that its neighbors still try.
            trying = (second < n_used[j]) & (best[3, j] < best[6, j])
            better = trying & (hypothesis[3, j] > 0.0) & (hypothesis[4, j] < best[4, j])
            best[0, j] = hypothesis[0, j] if better else best[0, j]
            best[1, j] = hypothesis[1, j] if better else best[1, j]
            best[2, j] = hypothesis[2, j] if better else best[2, j]
            best[3, j] += 1.0 if trying else 0.0
            best[4, j] = hypothesis[4, j] if better else best[4, j]
            best[5, j] = hypothesis[5, j] if better else best[5, j]
        n_undecided = 0
        for j in range(BLOCK):
            best[6, j] = required_tries[n_used[j], int(best[5, j])]
            n_undecided += 1 if best[3, j] < best[6, j] else 0
        if n_undecided == 0 or (p + 1 == early_limit and n_undecided <= _MAX_UNDECIDED):
            return n_undecided
    return 0
