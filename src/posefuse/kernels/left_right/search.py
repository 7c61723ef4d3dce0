"""Search for two points from rays with uncertain labels: two-ray points, and the cheapest candidates made of them.

One keypoint pair at a time. Observations are numbered ``2 view + label`` with label 0 left and 1 right. The cost of an
observation is the bounded cost of :func:`bounded`. Two points share the observations of the views such that each
observation supports at most one point. See docs/methods/left_right.md.
"""

import math

from posefuse.kernels.jit import inline, subroutine
from posefuse.kernels.linear_algebra.symmetric_3x3 import solve_symmetric

N_CANDIDATES = 4
"""Number of candidates kept for refinement."""
NO_POINT = -1
"""Index of a missing second point."""

# Maximum number of groups of points that share the same rays.
MAX_GROUPS = 48
# The costs of two-ray points exceed those of refined points by less than this many bounds.
_SLACK = 2.5
# A ray supports a point if its cost is below this fraction of the bound.
_SUPPORT_FRACTION = 0.95
_BITS = 62


@inline
def bounded(squared, full, inverse_span):
    """Return the bounded cost of a squared residual in sigmas: linear up to ``full``, then growing ever more slowly.

    Its derivative is the weight of reweighted Gauss-Newton, ``(1 - u)^2`` with u from 0 at ``full`` to 1 at ``none``.
    Beyond ``none`` the cost would stay at ``full + (none - full) / 3``.

    Args:
        squared: at most ``none``.
        full: end of the linear part.
        inverse_span: ``1 / (none - full)``.
    """
    excess = squared - full
    excess = excess if excess > 0.0 else 0.0
    u = excess * inverse_span
    return squared - excess * u * (1.0 - u * (1.0 / 3.0))


@inline
def _gather_lane(rows, weights, label, j, lane_rows, lane_weights, normal):
    """Gather the observations of one label in lane ``j``, and their parts of the algebraic normal equations."""
    for v in range(weights.shape[0]):
        o = 2 * v + label
        w = weights[v, j]
        lane_weights[o] = w
        for i in range(12):
            lane_rows[o, i] = rows[v, i, j]
        for i in range(3):
            normal[6 + i, o] = -w * (rows[v, i, j] * rows[v, 3, j] + rows[v, 4 + i, j] * rows[v, 7, j])
        g0 = rows[v, 0, j]
        g1 = rows[v, 1, j]
        g2 = rows[v, 2, j]
        h0 = rows[v, 4, j]
        h1 = rows[v, 5, j]
        h2 = rows[v, 6, j]
        normal[0, o] = w * (g0 * g0 + h0 * h0)
        normal[1, o] = w * (g0 * g1 + h0 * h1)
        normal[2, o] = w * (g0 * g2 + h0 * h2)
        normal[3, o] = w * (g1 * g1 + h1 * h1)
        normal[4, o] = w * (g1 * g2 + h1 * h2)
        normal[5, o] = w * (g2 * g2 + h2 * h2)


@inline
def _two_ray_points(ranks, n_observed, rank_pairs, j, lane):
    """Triangulate every two observations of two views; return the number of points."""
    normal, lane_weights, observations, points = lane.normal, lane.weights, lane.observations, lane.points
    count = 0
    for t in range(rank_pairs.shape[0]):
        if rank_pairs[t, 1] >= n_observed[j]:
            continue
        a = 2 * ranks[rank_pairs[t, 0], j]
        b = 2 * ranks[rank_pairs[t, 1], j]
        for label in range(4):
            first = a + (label & 1)
            second = b + (label >> 1)
            if lane_weights[first] > 0.0 and lane_weights[second] > 0.0:
                observations[0, count] = first
                observations[1, count] = second
                count += 1
    for p in range(count):
        a = observations[0, p]
        b = observations[1, p]
        _, points[0, p], points[1, p], points[2, p] = solve_symmetric(
            normal[0, a] + normal[0, b],
            normal[1, a] + normal[1, b],
            normal[2, a] + normal[2, b],
            normal[3, a] + normal[3, b],
            normal[4, a] + normal[4, b],
            normal[5, a] + normal[5, b],
            normal[6, a] + normal[6, b],
            normal[7, a] + normal[7, b],
            normal[8, a] + normal[8, b],
        )
    return count


@inline
def _compute_costs(lane_rows, lane_weights, points, count, full, none, costs):
    """Compute the cost of every observation for every point, shape (observation, point)."""
    inverse_span = 1.0 / (none - full)
    for o in range(lane_weights.shape[0]):
        w = lane_weights[o]
        if w == 0.0:
            for p in range(count):
                costs[o, p] = full + (none - full) * (1.0 / 3.0)
            continue
        g0, g1, g2, g3 = lane_rows[o, 0], lane_rows[o, 1], lane_rows[o, 2], lane_rows[o, 3]
        h0, h1, h2, h3 = lane_rows[o, 4], lane_rows[o, 5], lane_rows[o, 6], lane_rows[o, 7]
        c0, c1, c2, c3 = lane_rows[o, 8], lane_rows[o, 9], lane_rows[o, 10], lane_rows[o, 11]
        for p in range(count):
            x = points[0, p]
            y = points[1, p]
            z = points[2, p]
            depth = c0 * x + c1 * y + c2 * z + c3
            r = g0 * x + g1 * y + g2 * z + g3
            s = h0 * x + h1 * y + h2 * z + h3
            squared = w * (r * r + s * s) / (depth * depth)
            # The comparison is false for NaN, which results from parallel rays.
            near = (squared < none) & (depth > 0.0)
            costs[o, p] = bounded(squared if near else none, full, inverse_span)


@inline
def _summarize_points(costs, count, bound, single_cost, support_bits):
    """Compute the cost of each point with the nearer observation of every view, and its near observations as bits."""
    for p in range(count):
        single_cost[p] = 0.0
        support_bits[p] = 0
    for v in range(costs.shape[0] // 2):
        left = 1 << ((2 * v) % _BITS)
        right = left << 1
        for p in range(count):
            nearest = min(costs[2 * v, p], costs[2 * v + 1, p])
            single_cost[p] += nearest
            bit = left if costs[2 * v, p] <= costs[2 * v + 1, p] else right
            support_bits[p] |= bit if nearest < _SUPPORT_FRACTION * bound else 0


@inline
def _count_bits(bits):
    """Return the number of bits set in a number below 2^62."""
    bits = bits - ((bits >> 1) & 0x5555555555555555)
    bits = (bits & 0x3333333333333333) + ((bits >> 2) & 0x3333333333333333)
    bits = (bits + (bits >> 4)) & 0x0F0F0F0F0F0F0F0F
    bits = bits + (bits >> 8)
    bits = bits + (bits >> 16)
    return (bits + (bits >> 32)) & 0x7F


@inline
def _cheapest_point(single_cost, count):
    """Return the point with the lowest single cost, NO_POINT if none is left."""
    min_cost = math.inf
    chosen = NO_POINT
    for p in range(count):
        if single_cost[p] < min_cost:
            min_cost = single_cost[p]
            chosen = p
    return chosen


@inline
def _remove_group(single_cost, support_bits, chosen, count):
    """Remove all points that share most of their rays with the chosen one."""
    own_bits = support_bits[chosen]
    own_count = _count_bits(own_bits)
    for p in range(count):
        shared = _count_bits(support_bits[p] & own_bits)
        same = (shared >= 2) & (2 * shared > min(own_count, _count_bits(support_bits[p])))
        single_cost[p] = math.inf if same else single_cost[p]
    single_cost[chosen] = math.inf


@inline
def _insert_candidate(cost, first, second, best_costs, best_points):
    """Insert a candidate into the list of the cheapest."""
    position = N_CANDIDATES
    while position > 0 and cost < best_costs[position - 1]:
        position -= 1
    for i in range(N_CANDIDATES - 1, position, -1):
        best_costs[i] = best_costs[i - 1]
        best_points[0, i] = best_points[0, i - 1]
        best_points[1, i] = best_points[1, i - 1]
    if position < N_CANDIDATES:
        best_costs[position] = cost
        best_points[0, position] = first
        best_points[1, position] = second


@inline
def _candidate_cost(costs, n_views, first, second, bound):
    """Return the cost of two points with every view in its best state, and the number of views supporting each."""
    cost = 0.0
    n_first = 0
    n_second = 0
    for v in range(n_views):
        first_left = costs[2 * v, first]
        first_right = costs[2 * v + 1, first]
        second_left = costs[2 * v, second]
        second_right = costs[2 * v + 1, second]
        as_labelled = first_left + second_right <= first_right + second_left
        first_cost = first_left if as_labelled else first_right
        second_cost = second_right if as_labelled else second_left
        cost += first_cost + second_cost
        n_first += 1 if first_cost < bound else 0
        n_second += 1 if second_cost < bound else 0
    return cost, n_first, n_second


@inline
def _combine_points(lane, count, bound):
    """Find the cheapest candidates of two points with different rays; one point represents each similar group."""
    costs, single_cost, support_bits = lane.costs, lane.single_cost, lane.support_bits
    groups, best_costs, best_points = lane.groups, lane.best_costs, lane.best_points
    n_views = costs.shape[0] // 2
    n_groups = 0
    lowest_cost = math.inf
    for i in range(N_CANDIDATES):
        best_costs[i] = math.inf
        best_points[0, i] = NO_POINT
        best_points[1, i] = NO_POINT
    while n_groups < groups.shape[0]:
        chosen = _cheapest_point(single_cost, count)
        # No candidate costs less than the sum of the single costs of its points.
        if (
            chosen == NO_POINT
            or single_cost[chosen] + min(lowest_cost, single_cost[chosen]) > best_costs[0] + _SLACK * bound
        ):
            break
        lowest_cost = min(lowest_cost, single_cost[chosen])
        # One more ray may belong to a second point, which a single ray does not determine.
        _insert_candidate(single_cost[chosen] + (n_views - 1) * bound, chosen, NO_POINT, best_costs, best_points)
        for g in range(n_groups):
            cost, n_chosen, n_other = _candidate_cost(costs, n_views, chosen, groups[g], bound)
            if n_chosen > 1 and n_other > 1:
                _insert_candidate(cost, groups[g], chosen, best_costs, best_points)
        groups[n_groups] = chosen
        n_groups += 1
        _remove_group(single_cost, support_bits, chosen, count)


@subroutine
def propose_lane(workspace, rank_pairs, full, none, j, lane):
    """Find the cheapest candidates of two-ray points in lane ``j``, NaN where missing, the cheapest first.

    Args:
        workspace: a Workspace; the points of its first N_CANDIDATES candidates are written.
        rank_pairs: shape (try, 2), int64: ranks of views to combine.
        full, none: see :func:`bounded`, in squared sigmas.
        j: the lane.
        lane: a SearchWorkspace.
    """
    starts = workspace.candidates
    for label in range(2):
        _gather_lane(workspace.rows[label], workspace.weights[label], label, j, lane.rows, lane.weights, lane.normal)
    bound = full + (none - full) * (1.0 / 3.0)
    count = _two_ray_points(workspace.ranks, workspace.n_observed, rank_pairs, j, lane)
    _compute_costs(lane.rows, lane.weights, lane.points, count, full, none, lane.costs)
    _summarize_points(lane.costs, count, bound, lane.single_cost, lane.support_bits)
    _combine_points(lane, count, bound)
    for i in range(N_CANDIDATES):
        competitive = lane.best_costs[i] < lane.best_costs[0] + _SLACK * bound
        for side in range(2):
            p = lane.best_points[side, i] if competitive or i == 0 else NO_POINT
            for axis in range(3):
                starts[i, 3 * side + axis, j] = lane.points[axis, p] if p != NO_POINT else math.nan
