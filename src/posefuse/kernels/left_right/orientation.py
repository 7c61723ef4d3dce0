"""Which of two points is left: costs over time, Viterbi over a limb's orientations and over a view's swaps.

An orientation is a bit for each pair: 0 keeps the order of its two points, 1 exchanges them. Costs are negative
logarithms of likelihoods. The memory is what was seen last: of each pair's two points where, how well and when, of each
view what its labels said and when. See docs/methods.md, "Left and right".
"""

import math

from posefuse.kernels.jit import inline, kernel

_NU = 4.0
"""Degrees of freedom of the motion between frames, which has tails: most frames are calm, a kick is not."""
_CONTINUITY_AT_MOST = 12.0
_UNSEEN = 50.0
"""Cost of exchanging a pair where nothing of it is seen: the order is that of the last points, so it stays."""


@inline
def _mahalanobis(x, y, z, a, b, spread):
    """Squared length of (x, y, z) in units of the covariance a + b + spread on the diagonal; a, b: 6 entries."""
    xx, xy, xz = a[0] + b[0] + spread, a[1] + b[1], a[2] + b[2]
    yy, yz, zz = a[3] + b[3] + spread, a[4] + b[4], a[5] + b[5] + spread
    l11 = math.sqrt(xx)
    l21, l31 = xy / l11, xz / l11
    l22 = math.sqrt(max(yy - l21 * l21, 1e-12 * xx))
    l32 = (yz - l31 * l21) / l22
    l33 = math.sqrt(max(zz - l31 * l31 - l32 * l32, 1e-12 * xx))
    u = x / l11
    v = (y - l21 * u) / l22
    w = (z - l31 * u - l32 * v) / l33
    return u * u + v * v + w * w


@inline
def _between(point, covariance, then, then_covariance, spread):
    return _mahalanobis(point[0] - then[0], point[1] - then[1], point[2] - then[2], covariance, then_covariance, spread)


@inline
def _tails(kept, exchanged, n):
    """Cost of exchanging over keeping, from squared distances in n dimensions, by Student's law."""
    cost = 0.5 * (_NU + n) * (math.log1p(exchanged / _NU) - math.log1p(kept / _NU))
    return min(max(cost, -_CONTINUITY_AT_MOST), _CONTINUITY_AT_MOST)


@inline
def _turn(points, covariance, then, then_covariance, spread, both):
    """Cost of exchanging over keeping, from the vector between the two points, now and then.

    The motion they share is not in it. ``both``: shape (2, 6), scratch: the covariances of the two differences.
    """
    for i in range(6):
        both[0, i] = covariance[0, i] + covariance[1, i]
        both[1, i] = then_covariance[0, i] + then_covariance[1, i]
    dx, dy, dz = points[1, 0] - points[0, 0], points[1, 1] - points[0, 1], points[1, 2] - points[0, 2]
    ex, ey, ez = then[1, 0] - then[0, 0], then[1, 1] - then[0, 1], then[1, 2] - then[0, 2]
    kept = _mahalanobis(dx - ex, dy - ey, dz - ez, both[0], both[1], spread)
    exchanged = _mahalanobis(dx + ex, dy + ey, dz + ez, both[0], both[1], spread)
    return _tails(kept, exchanged, 3.0)


@inline
def _continuity(points, covariance, then, then_covariance, then_s, now_s, turn_speed, speed, both):
    """Cost of exchanging a pair's two points over keeping them, from where they were last."""
    here0, here1 = not math.isnan(points[0, 0]), not math.isnan(points[1, 0])
    was0, was1 = not math.isnan(then[0, 0]), not math.isnan(then[1, 0])
    if here0 and here1 and was0 and was1 and then_s[0] == then_s[1]:
        spread = (turn_speed * (now_s - then_s[0])) ** 2
        return _turn(points, covariance, then, then_covariance, spread, both)
    if not (was0 and was1):
        return 0.0
    spread0, spread1 = (speed * (now_s - then_s[0])) ** 2, (speed * (now_s - then_s[1])) ** 2
    kept, exchanged, n = 0.0, 0.0, 0.0
    if here0:
        kept += _between(points[0], covariance[0], then[0], then_covariance[0], spread0)
        exchanged += _between(points[0], covariance[0], then[1], then_covariance[1], spread1)
        n += 3.0
    if here1:
        kept += _between(points[1], covariance[1], then[1], then_covariance[1], spread1)
        exchanged += _between(points[1], covariance[1], then[0], then_covariance[0], spread0)
        n += 3.0
    return _tails(kept, exchanged, n)


@inline
def _labels(now, then, since_s, share, rate, weight, out):
    """Add what a view's labels now and then cost, for each orientation then (row) and now (column).

    The view is a chain of two states, right or swapped, swapped for ``share`` of the time and forgetting its state at
    ``rate``; ``now`` and ``then`` are the logarithms of odds that its labels are swapped against the points' order.
    """
    swapped_now, swapped_then = 1.0 / (1.0 + math.exp(-now)), 1.0 / (1.0 + math.exp(-then))
    forgotten = 1.0 - math.exp(-rate * since_s)
    enter, leave = share * forgotten, (1.0 - share) * forgotten
    for b in range(2):
        was = swapped_then if b == 0 else 1.0 - swapped_then
        expected = was * (1.0 - leave) + (1.0 - was) * enter
        for c in range(2):
            is_now = swapped_now if c == 0 else 1.0 - swapped_now
            out[b, c] -= weight * math.log(is_now * expected + (1.0 - is_now) * (1.0 - expected))


@inline
def _time_costs(points, covariance, odds, now_s, memory, speeds, views, both, out):
    """What every orientation of every pair costs, given the one before; as :func:`all_time_costs`, of one frame."""
    then, then_covariance, then_s, then_odds, odds_s = memory
    share, rate, weight = views
    for p in range(points.shape[0]):
        for b in range(2):
            out[p, b, 0] = 0.0
            out[p, b, 1] = 0.0
        for v in range(odds.shape[1]):
            if odds[p, v] != 0.0:
                since_s = now_s - odds_s[p, v]
                _labels(odds[p, v], then_odds[p, v], since_s, share[v], rate[v], weight[p, v], out[p])
        exchange = _UNSEEN
        if not (math.isnan(points[p, 0, 0]) and math.isnan(points[p, 1, 0])):
            exchange = _continuity(
                points[p], covariance[p], then[p], then_covariance[p], then_s[p], now_s, speeds[0][p], speeds[1][p],
                both,
            )  # fmt: skip
        out[p, 0, 1] += exchange
        out[p, 1, 0] += exchange


@inline
def _remember(points, covariance, odds, now_s, memory):
    then, then_covariance, then_s, then_odds, odds_s = memory
    for p in range(points.shape[0]):
        for i in range(2):
            if not math.isnan(points[p, i, 0]):
                for k in range(3):
                    then[p, i, k] = points[p, i, k]
                for k in range(6):
                    then_covariance[p, i, k] = covariance[p, i, k]
                then_s[p, i] = now_s
        for v in range(odds.shape[1]):
            if abs(odds[p, v]) > 0.5:
                then_odds[p, v] = odds[p, v]
                odds_s[p, v] = now_s


@kernel
def remember(points, covariance, odds, time_s, memory):
    """Put frames, in the order decided on, into the memory; arguments as of :func:`all_time_costs`."""
    for t in range(points.shape[0]):
        _remember(points[t], covariance[t], odds[t], time_s[t], memory)


@kernel
def all_time_costs(points, covariance, odds, time_s, memory, speeds, views, both, out):
    """What every orientation of every pair costs, given the one before, frame after frame.

    Args:
        points: shape (frame, pair, 2, 3), NaN where missing.
        covariance: shape (frame, pair, 2, 6).
        odds: shape (frame, pair, view): logarithms of the odds that a view's labels are swapped against the order.
        time_s: shape (frame,).
        memory: what was seen last, updated: points (pair, 2, 3), covariances (pair, 2, 6), when (pair, 2), odds
            (pair, view), when (pair, view).
        speeds: shape (pair,), twice: how fast the vector between two points changes, how fast a point does, m/s.
        views: the share of the time that a view's labels are swapped (view,), how fast it forgets whether they are
            (view,), 1/s, and how much a pair's label counts (pair, view).
        both: shape (2, 6), scratch.
        out: shape (frame, pair, 2, 2), written: orientation before, orientation now.
    """
    for t in range(points.shape[0]):
        _time_costs(points[t], covariance[t], odds[t], time_s[t], memory, speeds, views, both, out[t])
        _remember(points[t], covariance[t], odds[t], time_s[t], memory)


@inline
def _pass_on(costs, origin, s, other, time_cost):
    """The two states that differ in one pair's bit, from before it may be exchanged to after."""
    keep, swap = costs[s], costs[other]
    first, second = origin[s], origin[other]
    if keep + time_cost[0, 0] <= swap + time_cost[1, 0]:
        costs[s], origin[s] = keep + time_cost[0, 0], first
    else:
        costs[s], origin[s] = swap + time_cost[1, 0], second
    if swap + time_cost[1, 1] <= keep + time_cost[0, 1]:
        costs[other], origin[other] = swap + time_cost[1, 1], second
    else:
        costs[other], origin[other] = keep + time_cost[0, 1], first


@inline
def _cost_now(s, field, link_cost, members, links, link_ends):
    """What a state costs by this frame alone."""
    cost = 0.0
    for j in range(members.shape[0]):
        if s & (1 << j):
            cost += field[members[j]]
    for k in range(links.shape[0]):
        if ((s >> link_ends[k, 0]) ^ (s >> link_ends[k, 1])) & 1:
            cost += link_cost[links[k]]
    return cost


@inline
def _advance(costs, origin, time_cost, field, link_cost, members, links, link_ends):
    """One step of Viterbi over a block's orientations: ``costs`` and where each came from are updated."""
    for s in range(costs.shape[0]):
        origin[s] = s
    # Transitions of pairs are independent, so bit after bit is exact and takes J 2^J steps instead of 4^J.
    for j in range(members.shape[0]):
        for s in range(costs.shape[0]):
            if not s & (1 << j):
                _pass_on(costs, origin, s, s | (1 << j), time_cost[members[j]])
    least = math.inf
    for s in range(costs.shape[0]):
        costs[s] += _cost_now(s, field, link_cost, members, links, link_ends)
        least = min(least, costs[s])
    for s in range(costs.shape[0]):
        costs[s] -= least


@kernel
def decide_block(time_cost, field, link_cost, members, links, link_ends, costs, origin, out):
    """The cheapest orientations of a block over time.

    Args:
        time_cost: shape (frame, pair, 2, 2): orientation before, orientation now.
        field: shape (frame, pair): cost of exchanging the pair's points.
        link_cost: shape (frame, link): cost of two linked pairs not being exchanged alike.
        members: shape (J,), int64: the block's pairs, the first being the lowest bit of a state.
        links: shape (K,), int64: links within the block.
        link_ends: shape (K, 2), int64: which bits they join.
        costs: shape (2^J,), of each state before the first frame; those after the last frame at the end.
        origin: shape (frame, 2^J), int64, scratch.
        out: shape (frame, pair), bool: the members' columns are written.
    """
    n = time_cost.shape[0]
    for t in range(n):
        _advance(costs, origin[t], time_cost[t], field[t], link_cost[t], members, links, link_ends)
    state = 0
    for s in range(costs.shape[0]):
        if costs[s] < costs[state]:
            state = s
    for t in range(n - 1, -1, -1):
        for j in range(members.shape[0]):
            out[t, members[j]] = (state >> j) & 1 == 1
        state = origin[t, state]


@kernel
def add_across(field, link_cost, links, across, flipped, known, out):
    """What exchanging each pair costs: its field, and its links to known pairs of other blocks, as these stand.

    Args:
        field: shape (frame, pair).
        link_cost: shape (frame, link).
        links: shape (link, 2), int64: pairs.
        across: shape (A,), int64: links that join two blocks.
        flipped: shape (frame, pair), bool.
        known: shape (pair,), bool.
        out: shape (frame, pair), written.
    """
    for t in range(field.shape[0]):
        for p in range(field.shape[1]):
            out[t, p] = field[t, p]
        for k in across:
            a, b = links[k, 0], links[k, 1]
            if known[b]:
                out[t, a] += -link_cost[t, k] if flipped[t, b] else link_cost[t, k]
            if known[a]:
                out[t, b] += -link_cost[t, k] if flipped[t, a] else link_cost[t, k]


@kernel
def swap_states(odds, time_s, share, rate, came_from, out):
    """Whether each view's labels are swapped, by Viterbi over the two states.

    Args:
        odds: shape (frame, view): logarithms of the odds that they are, from this frame alone.
        time_s: shape (frame,).
        share, rate: shape (view,), as in :func:`time_costs`.
        came_from: shape (frame, 2), int64, scratch.
        out: shape (frame, view), int8, written: 0 or 1.
    """
    n = odds.shape[0]
    for v in range(odds.shape[1]):
        right, swapped = -math.log(1.0 - share[v]), -math.log(share[v])
        for t in range(n):
            if t > 0:
                forgotten = max(1.0 - math.exp(-rate[v] * (time_s[t] - time_s[t - 1])), 1e-9)
                enter, leave = share[v] * forgotten, (1.0 - share[v]) * forgotten
                stay_right, come_right = right - math.log(1.0 - enter), swapped - math.log(leave)
                stay_swapped, come_swapped = swapped - math.log(1.0 - leave), right - math.log(enter)
                came_from[t, 0] = 0 if stay_right <= come_right else 1
                came_from[t, 1] = 1 if stay_swapped <= come_swapped else 0
                right, swapped = min(stay_right, come_right), min(stay_swapped, come_swapped)
            right += 0.5 * odds[t, v]
            swapped -= 0.5 * odds[t, v]
        state = 0 if right <= swapped else 1
        for t in range(n - 1, -1, -1):
            out[t, v] = state
            state = came_from[t, state]


@inline
def _off(x, y, length, sd):
    """Bounded squared deviation of the distance of two points from a bone's length, in units of its spread."""
    distance = math.sqrt((x[0] - y[0]) ** 2 + (x[1] - y[1]) ** 2 + (x[2] - y[2]) ** 2)
    return min(((distance - length) / sd) ** 2, 9.0)


@inline
def _bone(a, b, length, sd):
    """Cost of exchanging one of two pairs over exchanging none, from the length of the bone that joins them."""
    cost = 0.0
    for i in range(2):
        if math.isnan(a[i, 0]):
            continue
        if not (math.isnan(b[0, 0]) or math.isnan(b[1, 0])):
            cost += 0.5 * (_off(a[i], b[1 - i], length, sd) - _off(a[i], b[i], length, sd))
    if math.isnan(b[0, 0]) != math.isnan(b[1, 0]) and not (math.isnan(a[0, 0]) or math.isnan(a[1, 0])):
        i = 0 if math.isnan(b[1, 0]) else 1
        cost += 0.5 * (_off(a[1 - i], b[i], length, sd) - _off(a[i], b[i], length, sd))
    return cost


@inline
def _cosine(a, b):
    """Of the vectors between the two points of two pairs; 0 where a point is missing."""
    dot, aa, bb = 0.0, 0.0, 0.0
    for k in range(3):
        x, y = a[1, k] - a[0, k], b[1, k] - b[0, k]
        dot, aa, bb = dot + x * y, aa + x * x, bb + y * y
    return dot / math.sqrt(aa * bb) if aa * bb > 0.0 else 0.0


@kernel
def link_costs(points, odds, links, length, length_sd, likeness, likeness_sd, together, most, share_of_bones, out):
    """What it costs to exchange one of two linked pairs and not the other.

    Args:
        points: shape (frame, pair, 2, 3).
        odds: shape (frame, pair, view).
        links: shape (link, 2), int64: pairs.
        length, length_sd: shape (link,): of the bone that joins them on each side, m.
        likeness, likeness_sd: shape (link,): of the cosine between their two vectors.
        together: shape (link, view): logarithm of the odds that a view's labels of both go together.
        most: no frame's bones cost more.
        share_of_bones: what they count for; errors of such a model last for many frames.
        out: shape (frame, link), written.
    """
    for t in range(points.shape[0]):
        for k in range(links.shape[0]):
            a, b = links[k, 0], links[k, 1]
            cost = _bone(points[t, a], points[t, b], length[k], length_sd[k])
            cosine = _cosine(points[t, a], points[t, b])
            if not math.isnan(cosine):
                cost += 2.0 * cosine * likeness[k] / likeness_sd[k] ** 2
            cost = share_of_bones * min(max(cost, -most), most)
            for v in range(odds.shape[2]):
                if together[k, v] > 0.0:
                    agree = math.tanh(odds[t, a, v] / 2) * math.tanh(odds[t, b, v] / 2) * math.tanh(together[k, v] / 2)
                    cost += 2.0 * math.atanh(agree)
            out[t, k] = cost
