"""Two-view hypotheses: views in the order of trust, pairs of them, and the pair whose point most views agree with."""

import math

from posefuse.kernels.cameras.observation_rows import BLOCK, residual
from posefuse.kernels.cameras.points import solve_symmetric
from posefuse.kernels.jit import inline

# Of a block; the others would all have to wait for them.
_FEW = BLOCK // 4


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
def copy_pair(rows, weights, a, b, j, pair, pair_weights):
    """Rows and weights of a lane's views ``a`` and ``b``: side by side, what follows works on all lanes at once."""
    pair_weights[0, j] = weights[a, j]
    pair_weights[1, j] = weights[b, j]
    for i in range(12):
        pair[0, i, j] = rows[a, i, j]
        pair[1, i, j] = rows[b, i, j]


@inline
def two_view_point(pair, pair_weights, j):
    """The algebraic point of the pair of lane ``j``.

    Returns:
        ``(found, x, y, z)``, found 1.0 where there is one in front of both, else 0.0.
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
def search(rows, weights, ranks, used, pairs, enough, brief, bound, pair, pair_weights, trial, best):
    """The best-scoring two-view point of each lane.

    Args:
        rows: shape (view, 12, BLOCK).
        weights: shape (view, BLOCK).
        ranks: views by rank, from :func:`rank_views`.
        used: shape (BLOCK,), how many views each lane has.
        pairs: shape (pair, 2), int64: ranks to try together, the most promising first.
        enough: shape (view + 1, view + 1), int64: with so many views, of which so many agree, after how many tried
            pairs a better point is no longer to be expected.
        brief: after so many pairs the search may end with a few lanes undecided; 0 if it may not.
        bound: what a view that disagrees costs, in squared sigma units.
        pair: shape (2, 12, BLOCK), scratch.
        pair_weights: shape (2, BLOCK), scratch.
        trial: shape (6, BLOCK), scratch.
        best: shape (7, BLOCK), written: point, pairs tried, cost, views that agree, pairs to try.

    Returns:
        How many lanes are undecided: there more pairs should be tried than were.
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
            copy_pair(rows, weights, ranks[first, j], ranks[second, j], j, pair, pair_weights)
        for j in range(BLOCK):
            trial[3, j], trial[0, j], trial[1, j], trial[2, j] = two_view_point(pair, pair_weights, j)
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
        if waiting == 0 or (p + 1 == brief and waiting <= _FEW):
            return waiting
    return 0
