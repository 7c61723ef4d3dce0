"""Where two points may be, from rays whose labels are not believed: two-ray points, and the couples that cost least.

One couple of keypoints at a time. An observation is numbered ``2 view + label``, label 0 left and 1 right. What an
observation costs a point is the bounded cost of :func:`bounded`; two points share the views' observations so that
each serves one point at most. See docs/methods.md, "Pairs".
"""

import math

from posefuse.kernels.cameras.points import solve_symmetric
from posefuse.kernels.jit import inline, step

PROPOSALS = 4
"""Couples of points kept for refinement."""
NOBODY = -1
"""In the place of a second point: there is none."""

# Representatives of groups of proposals that rest on the same rays.
MOST_GROUPS = 48
# Costs of two-ray points are above those of refined ones by less than so many bounds.
_SLACK = 2.5
# A ray this much of the bound away belongs to a point no more.
_NEAR = 0.95
_BITS = 62


@inline
def bounded(squared, full, inverse_span):
    """The cost of a squared residual in sigma units: itself up to ``full``, then growing ever less.

    Its derivative is the weight of reweighted Gauss-Newton, ``(1 - u)^2``, u from 0 at ``full`` to 1 at ``none``; past
    that the cost would stay at ``full + (none - full) / 3``.

    Args:
        squared: at most ``none``.
        full: from where on the cost grows more slowly.
        inverse_span: ``1 / (none - full)``.
    """
    over = squared - full
    over = over if over > 0.0 else 0.0
    u = over * inverse_span
    return squared - over * u * (1.0 - u * (1.0 / 3.0))


@inline
def _take_lane(rows, weights, label, j, lane_rows, lane_weights, normal):
    """The observations of one label in lane ``j``, and their parts of the algebraic normal equations."""
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
def _two_ray_points(normal, lane_weights, ranks, seen, tries, j, places, points):
    """The algebraic point of every two observations of two views; how many there are."""
    count = 0
    for t in range(tries.shape[0]):
        if tries[t, 1] >= seen[j]:
            continue
        a = 2 * ranks[tries[t, 0], j]
        b = 2 * ranks[tries[t, 1], j]
        for label in range(4):
            first = a + (label & 1)
            second = b + (label >> 1)
            if lane_weights[first] > 0.0 and lane_weights[second] > 0.0:
                places[0, count] = first
                places[1, count] = second
                count += 1
    for p in range(count):
        a = places[0, p]
        b = places[1, p]
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
def _cost_of_all(lane_rows, lane_weights, points, count, full, none, costs):
    """What every observation costs every point, shape (observation, point)."""
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
            # Not a number, where two rays are parallel, is not near either.
            near = (squared < none) & (depth > 0.0)
            costs[o, p] = bounded(squared if near else none, full, inverse_span)


@inline
def _describe(costs, count, bound, alone, rests_on):
    """What each point costs with the nearer observation of every view, and, as bits, which of those are near."""
    for p in range(count):
        alone[p] = 0.0
        rests_on[p] = 0
    for v in range(costs.shape[0] // 2):
        left = 1 << ((2 * v) % _BITS)
        right = left << 1
        for p in range(count):
            nearest = min(costs[2 * v, p], costs[2 * v + 1, p])
            alone[p] += nearest
            bit = left if costs[2 * v, p] <= costs[2 * v + 1, p] else right
            rests_on[p] |= bit if nearest < _NEAR * bound else 0


@inline
def _ones(bits):
    """How many bits of a number below 2^62 are set."""
    bits = bits - ((bits >> 1) & 0x5555555555555555)
    bits = (bits & 0x3333333333333333) + ((bits >> 2) & 0x3333333333333333)
    bits = (bits + (bits >> 4)) & 0x0F0F0F0F0F0F0F0F
    bits = bits + (bits >> 8)
    bits = bits + (bits >> 16)
    return (bits + (bits >> 32)) & 0x7F


@inline
def _cheapest(alone, count):
    """The point that costs least alone, NOBODY where none is left."""
    least = math.inf
    chosen = NOBODY
    for p in range(count):
        if alone[p] < least:
            least = alone[p]
            chosen = p
    return chosen


@inline
def _close_group(alone, rests_on, chosen, count):
    """Strike out all points that rest, for the most part, on the rays of the chosen one."""
    mine = rests_on[chosen]
    size = _ones(mine)
    for p in range(count):
        shared = _ones(rests_on[p] & mine)
        same = (shared >= 2) & (2 * shared > min(size, _ones(rests_on[p])))
        alone[p] = math.inf if same else alone[p]
    alone[chosen] = math.inf


@inline
def _keep(cost, first, second, kept, kept_places):
    """Insert a couple among the cheapest."""
    place = PROPOSALS
    while place > 0 and cost < kept[place - 1]:
        place -= 1
    for i in range(PROPOSALS - 1, place, -1):
        kept[i] = kept[i - 1]
        kept_places[0, i] = kept_places[0, i - 1]
        kept_places[1, i] = kept_places[1, i - 1]
    if place < PROPOSALS:
        kept[place] = cost
        kept_places[0, place] = first
        kept_places[1, place] = second


@inline
def _couple_cost(costs, n_views, first, second, bound):
    """What two points cost, every view in its best state, and how many views then hold each."""
    cost = 0.0
    held_first = 0
    held_second = 0
    for v in range(n_views):
        first_left = costs[2 * v, first]
        first_right = costs[2 * v + 1, first]
        second_left = costs[2 * v, second]
        second_right = costs[2 * v + 1, second]
        as_labelled = first_left + second_right <= first_right + second_left
        of_first = first_left if as_labelled else first_right
        of_second = second_right if as_labelled else second_left
        cost += of_first + of_second
        held_first += 1 if of_first < bound else 0
        held_second += 1 if of_second < bound else 0
    return cost, held_first, held_second


@inline
def _couple(costs, count, bound, alone, rests_on, groups, kept, kept_places):
    """The cheapest couples of points that rest on different rays, each group of like points having one speaker."""
    n_views = costs.shape[0] // 2
    n_groups = 0
    lowest = math.inf
    for i in range(PROPOSALS):
        kept[i] = math.inf
        kept_places[0, i] = NOBODY
        kept_places[1, i] = NOBODY
    while n_groups < groups.shape[0]:
        chosen = _cheapest(alone, count)
        # No couple costs less than its points do alone.
        if chosen == NOBODY or alone[chosen] + min(lowest, alone[chosen]) > kept[0] + _SLACK * bound:
            break
        lowest = min(lowest, alone[chosen])
        # One more ray may be that of a second point, which it does not fix.
        _keep(alone[chosen] + (n_views - 1) * bound, chosen, NOBODY, kept, kept_places)
        for g in range(n_groups):
            cost, held_chosen, held_other = _couple_cost(costs, n_views, chosen, groups[g], bound)
            if held_chosen > 1 and held_other > 1:
                _keep(cost, groups[g], chosen, kept, kept_places)
        groups[n_groups] = chosen
        n_groups += 1
        _close_group(alone, rests_on, chosen, count)


@step
def search_lane(rows, weights, ranks, seen, tries, full, none, j, room, starts):
    """The cheapest couples of two-ray points of lane ``j``.

    Args:
        rows: shape (label, view, 12, BLOCK).
        weights: shape (label, view, BLOCK); 0 is not there.
        ranks: shape (view, BLOCK), views by confidence.
        seen: shape (BLOCK,), how many views have an observation of either label.
        tries: shape (try, 2), int64: ranks to try together.
        full, none: see :func:`bounded`, in squared sigma units.
        j: the lane.
        room: a SearchRoom, scratch.
        starts: shape (PROPOSALS, 6 or more, BLOCK), written: two points, the cheapest couple first; NaN where there is
            none.
    """
    for label in range(2):
        _take_lane(rows[label], weights[label], label, j, room.rows, room.weights, room.normal)
    bound = full + (none - full) * (1.0 / 3.0)
    count = _two_ray_points(room.normal, room.weights, ranks, seen, tries, j, room.places, room.points)
    _cost_of_all(room.rows, room.weights, room.points, count, full, none, room.costs)
    _describe(room.costs, count, bound, room.alone, room.rests_on)
    _couple(room.costs, count, bound, room.alone, room.rests_on, room.groups, room.kept, room.kept_places)
    for i in range(PROPOSALS):
        close = room.kept[i] < room.kept[0] + _SLACK * bound
        for side in range(2):
            p = room.kept_places[side, i] if close or i == 0 else NOBODY
            for axis in range(3):
                starts[i, 3 * side + axis, j] = room.points[axis, p] if p != NOBODY else math.nan
