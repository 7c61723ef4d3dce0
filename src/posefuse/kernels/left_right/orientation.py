"""Assignment of left and right to point pairs: costs over time, and Viterbi over limb orientations and view swaps.

An orientation has one bit per pair: 0 keeps the order of its two points, 1 exchanges them. Costs are negative log
likelihoods. The memory holds the last observation: position, covariance and time of both points of each pair, and label
log odds and time of each view. See docs/methods/left_right.md.
"""

import math

from posefuse.kernels.jit import inline, kernel

_NU = 4.0
"""Degrees of freedom of the motion between frames: most frames are calm, but motion has heavy tails."""
_MAX_CONTINUITY_COST = 12.0
_UNSEEN_COST = 50.0
"""Cost of exchanging a pair that is not observed: its order is that of the last points."""


@inline
def _mahalanobis_squared(x, y, z, a, b, process_variance):
    """Return the squared length of (x, y, z) for the covariance a + b + process_variance I; a, b have 6 entries."""
    xx, xy, xz = a[0] + b[0] + process_variance, a[1] + b[1], a[2] + b[2]
    yy, yz, zz = a[3] + b[3] + process_variance, a[4] + b[4], a[5] + b[5] + process_variance
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
def _distance_squared(point, covariance, last_points, last_covariance, process_variance):
    """Return the squared Mahalanobis distance of a point from its last position."""
    return _mahalanobis_squared(
        point[0] - last_points[0],
        point[1] - last_points[1],
        point[2] - last_points[2],
        covariance,
        last_covariance,
        process_variance,
    )


@inline
def _exchange_cost(kept_squared, exchanged_squared, n):
    """Return the cost of exchanging over keeping, by a Student t distribution of n-dimensional distances."""
    cost = 0.5 * (_NU + n) * (math.log1p(exchanged_squared / _NU) - math.log1p(kept_squared / _NU))
    return min(max(cost, -_MAX_CONTINUITY_COST), _MAX_CONTINUITY_COST)


@inline
def _direction_cost(points, covariance, last_points, last_covariance, process_variance, scratch):
    """Return the cost of exchanging over keeping, from the vector between the two points now and before.

    Common motion of both points cancels. ``scratch``, shape (2, 6), receives the covariances of the two differences.
    """
    for i in range(6):
        scratch[0, i] = covariance[0, i] + covariance[1, i]
        scratch[1, i] = last_covariance[0, i] + last_covariance[1, i]
    dx, dy, dz = points[1, 0] - points[0, 0], points[1, 1] - points[0, 1], points[1, 2] - points[0, 2]
    ex, ey, ez = (
        last_points[1, 0] - last_points[0, 0],
        last_points[1, 1] - last_points[0, 1],
        last_points[1, 2] - last_points[0, 2],
    )
    kept_squared = _mahalanobis_squared(dx - ex, dy - ey, dz - ez, scratch[0], scratch[1], process_variance)
    exchanged_squared = _mahalanobis_squared(dx + ex, dy + ey, dz + ez, scratch[0], scratch[1], process_variance)
    return _exchange_cost(kept_squared, exchanged_squared, 3.0)


@inline
def _continuity_cost(points, covariance, p, now_s, memory, speeds, scratch):
    """Return the cost of exchanging the two points of pair ``p`` over keeping them, from their last positions."""
    last_points, last_covariance, last_s = memory.points[p], memory.covariance[p], memory.points_s[p]
    turn_speed, speed = speeds.turn[p], speeds.point[p]
    present0, present1 = not math.isnan(points[0, 0]), not math.isnan(points[1, 0])
    known0, known1 = not math.isnan(last_points[0, 0]), not math.isnan(last_points[1, 0])
    if present0 and present1 and known0 and known1 and last_s[0] == last_s[1]:
        process_variance = (turn_speed * (now_s - last_s[0])) ** 2
        return _direction_cost(points, covariance, last_points, last_covariance, process_variance, scratch)
    if not (known0 and known1):
        return 0.0
    spread0, spread1 = (speed * (now_s - last_s[0])) ** 2, (speed * (now_s - last_s[1])) ** 2
    kept_squared, exchanged_squared, n = 0.0, 0.0, 0.0
    if present0:
        kept_squared += _distance_squared(points[0], covariance[0], last_points[0], last_covariance[0], spread0)
        exchanged_squared += _distance_squared(points[0], covariance[0], last_points[1], last_covariance[1], spread1)
        n += 3.0
    if present1:
        kept_squared += _distance_squared(points[1], covariance[1], last_points[1], last_covariance[1], spread1)
        exchanged_squared += _distance_squared(points[1], covariance[1], last_points[0], last_covariance[0], spread0)
        n += 3.0
    return _exchange_cost(kept_squared, exchanged_squared, n)


@inline
def _add_label_costs(odds_now, last_points, elapsed_s, swap_fraction, forgetting_rate, weight, out):
    """Add the cost of the labels of a view, now and before, for each orientation before (row) and now (column).

    The view is a two-state Markov chain, correct or swapped. It is swapped for the fraction ``swap_fraction`` of the
    time and forgets its state at ``forgetting_rate``. ``odds_now`` and ``last_odds`` are log odds that its labels are
    swapped relative to the order of the points.
    """
    swapped_now, swapped_then = 1.0 / (1.0 + math.exp(-odds_now)), 1.0 / (1.0 + math.exp(-last_points))
    forgotten = 1.0 - math.exp(-forgetting_rate * elapsed_s)
    enter, leave = swap_fraction * forgotten, (1.0 - swap_fraction) * forgotten
    for b in range(2):
        was_swapped = swapped_then if b == 0 else 1.0 - swapped_then
        expected = was_swapped * (1.0 - leave) + (1.0 - was_swapped) * enter
        for c in range(2):
            is_swapped = swapped_now if c == 0 else 1.0 - swapped_now
            out[b, c] -= weight * math.log(is_swapped * expected + (1.0 - is_swapped) * (1.0 - expected))


@inline
def _frame_costs(frames, t, memory, speeds, label_model, scratch, out):
    """Compute the costs of :func:`temporal_costs` for one frame."""
    points, covariance, odds, now_s = frames.points[t], frames.covariance[t], frames.odds[t], frames.time_s[t]
    last_odds, odds_s = memory.odds, memory.odds_s
    swap_fraction, forgetting_rate, weight = label_model
    for p in range(points.shape[0]):
        for b in range(2):
            out[p, b, 0] = 0.0
            out[p, b, 1] = 0.0
        for v in range(odds.shape[1]):
            if odds[p, v] != 0.0:
                elapsed_s = now_s - odds_s[p, v]
                _add_label_costs(
                    odds[p, v], last_odds[p, v], elapsed_s, swap_fraction[v], forgetting_rate[v], weight[p, v], out[p]
                )
        exchange = _UNSEEN_COST
        if not (math.isnan(points[p, 0, 0]) and math.isnan(points[p, 1, 0])):
            exchange = _continuity_cost(points[p], covariance[p], p, now_s, memory, speeds, scratch)
        out[p, 0, 1] += exchange
        out[p, 1, 0] += exchange


@inline
def _update_memory(frames, t, memory):
    """Store one frame in the memory."""
    points, covariance, odds, now_s = frames.points[t], frames.covariance[t], frames.odds[t], frames.time_s[t]
    last_points, last_covariance, last_s, last_odds, odds_s = memory
    for p in range(points.shape[0]):
        for i in range(2):
            if not math.isnan(points[p, i, 0]):
                for k in range(3):
                    last_points[p, i, k] = points[p, i, k]
                for k in range(6):
                    last_covariance[p, i, k] = covariance[p, i, k]
                last_s[p, i] = now_s
        for v in range(odds.shape[1]):
            if abs(odds[p, v]) > 0.5:
                last_odds[p, v] = odds[p, v]
                odds_s[p, v] = now_s


@kernel
def temporal_costs(frames, memory, speeds, label_model, scratch, out):
    """Compute the cost of every orientation of every pair given the previous orientation, for each frame.

    Args:
        frames: PairFrames.
        memory: a PairMemory, in and out.
        speeds: MotionSpeeds.
        label_model: a LabelModel.
        scratch: shape (2, 6), scratch.
        out: shape (frame, pair, 2, 2), written: orientation before, orientation now.
    """
    for t in range(frames.points.shape[0]):
        _frame_costs(frames, t, memory, speeds, label_model, scratch, out[t])
        _update_memory(frames, t, memory)


@inline
def _minimize_transition(costs, origin, s, other, time_cost):
    """Minimize over the transition of one pair's bit, in place for the two states that differ in it."""
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
def _state_cost(s, pair_cost, link_cost, block):
    """Return the cost of a state from the current frame alone."""
    members, links, link_ends = block
    cost = 0.0
    for j in range(members.shape[0]):
        if s & (1 << j):
            cost += pair_cost[members[j]]
    for k in range(links.shape[0]):
        if ((s >> link_ends[k, 0]) ^ (s >> link_ends[k, 1])) & 1:
            cost += link_cost[links[k]]
    return cost


@inline
def _viterbi_step(costs, origin, time_cost, pair_cost, link_cost, block):
    """Perform one Viterbi step over the orientations of a block; update the costs and the predecessors."""
    members = block.members
    for s in range(costs.shape[0]):
        origin[s] = s
    # Transitions of pairs are independent, so processing bit by bit is exact and takes J 2^J steps instead of 4^J.
    for j in range(members.shape[0]):
        for s in range(costs.shape[0]):
            if not s & (1 << j):
                _minimize_transition(costs, origin, s, s | (1 << j), time_cost[members[j]])
    least = math.inf
    for s in range(costs.shape[0]):
        costs[s] += _state_cost(s, pair_cost, link_cost, block)
        least = min(least, costs[s])
    for s in range(costs.shape[0]):
        costs[s] -= least


@kernel
def find_orientations(costs, block, state_costs, origin, out):
    """Find the cheapest orientations of a block over time.

    Args:
        costs: OrientationCosts.
        block: a PairBlock.
        state_costs: shape (2^J,), cost of each state before the first frame; on output, after the last frame.
        origin: shape (frame, 2^J), int64, scratch.
        out: shape (frame, pair), bool: the columns of the members are written.
    """
    members = block.members
    n = costs.time.shape[0]
    for t in range(n):
        _viterbi_step(state_costs, origin[t], costs.time[t], costs.pair[t], costs.link[t], block)
    state = 0
    for s in range(state_costs.shape[0]):
        if state_costs[s] < state_costs[state]:
            state = s
    for t in range(n - 1, -1, -1):
        for j in range(members.shape[0]):
            out[t, members[j]] = (state >> j) & 1 == 1
        state = origin[t, state]


@kernel
def add_cross_links(pair_cost, link_cost, links, cross_links, exchanged_now, decided, out):
    """Compute the cost of exchanging each pair: its own and that of its links to decided pairs of other blocks.

    Args:
        pair_cost: shape (frame, pair).
        link_cost: shape (frame, link).
        links: shape (link, 2), int64: pairs.
        cross_links: shape (A,), int64: links between two blocks.
        exchanged_now: shape (frame, pair), bool.
        decided: shape (pair,), bool.
        out: shape (frame, pair), written.
    """
    for t in range(pair_cost.shape[0]):
        for p in range(pair_cost.shape[1]):
            out[t, p] = pair_cost[t, p]
        for k in cross_links:
            a, b = links[k, 0], links[k, 1]
            if decided[b]:
                out[t, a] += -link_cost[t, k] if exchanged_now[t, b] else link_cost[t, k]
            if decided[a]:
                out[t, b] += -link_cost[t, k] if exchanged_now[t, a] else link_cost[t, k]


@kernel
def find_swap_states(odds, time_s, swap_fraction, forgetting_rate, predecessor, out):
    """Find whether the labels of each view are swapped over time, by Viterbi over the two states.

    Args:
        odds: shape (frame, view): log odds of a swap from each frame alone.
        time_s: shape (frame,).
        swap_fraction, forgetting_rate: shape (view,), as in :func:`temporal_costs`.
        predecessor: shape (frame, 2), int64, scratch.
        out: shape (frame, view), int8, written: 0 or 1.
    """
    n = odds.shape[0]
    for v in range(odds.shape[1]):
        right, swapped = -math.log(1.0 - swap_fraction[v]), -math.log(swap_fraction[v])
        for t in range(n):
            if t > 0:
                forgotten = max(1.0 - math.exp(-forgetting_rate[v] * (time_s[t] - time_s[t - 1])), 1e-9)
                enter, leave = swap_fraction[v] * forgotten, (1.0 - swap_fraction[v]) * forgotten
                stay_right, become_right = right - math.log(1.0 - enter), swapped - math.log(leave)
                stay_swapped, become_swapped = swapped - math.log(1.0 - leave), right - math.log(enter)
                predecessor[t, 0] = 0 if stay_right <= become_right else 1
                predecessor[t, 1] = 1 if stay_swapped <= become_swapped else 0
                right, swapped = min(stay_right, become_right), min(stay_swapped, become_swapped)
            right += 0.5 * odds[t, v]
            swapped -= 0.5 * odds[t, v]
        state = 0 if right <= swapped else 1
        for t in range(n - 1, -1, -1):
            out[t, v] = state
            state = predecessor[t, state]


@inline
def _length_deviation(x, y, length, sd):
    """Return the bounded squared deviation of a distance from the length of a bone, in standard deviations."""
    distance = math.sqrt((x[0] - y[0]) ** 2 + (x[1] - y[1]) ** 2 + (x[2] - y[2]) ** 2)
    return min(((distance - length) / sd) ** 2, 9.0)


@inline
def _bone_cost(a, b, length, sd):
    """Return the cost of exchanging one of two pairs over exchanging none, from the length of the bone between them."""
    cost = 0.0
    for i in range(2):
        if math.isnan(a[i, 0]):
            continue
        if not (math.isnan(b[0, 0]) or math.isnan(b[1, 0])):
            cost += 0.5 * (_length_deviation(a[i], b[1 - i], length, sd) - _length_deviation(a[i], b[i], length, sd))
    if math.isnan(b[0, 0]) != math.isnan(b[1, 0]) and not (math.isnan(a[0, 0]) or math.isnan(a[1, 0])):
        i = 0 if math.isnan(b[1, 0]) else 1
        cost += 0.5 * (_length_deviation(a[1 - i], b[i], length, sd) - _length_deviation(a[i], b[i], length, sd))
    return cost


@inline
def _cosine(a, b):
    """Return the cosine between the difference vectors of two pairs; 0 if one vanishes, NaN if a point is missing."""
    dot, aa, bb = 0.0, 0.0, 0.0
    for k in range(3):
        x, y = a[1, k] - a[0, k], b[1, k] - b[0, k]
        dot, aa, bb = dot + x * y, aa + x * x, bb + y * y
    return dot / math.sqrt(aa * bb) if aa * bb > 0.0 else 0.0


@kernel
def link_costs(points, odds, model, max_cost, bone_weight, out):
    """Compute the cost of exchanging only one of two linked pairs.

    Args:
        points: shape (frame, pair, 2, 3).
        odds: shape (frame, pair, view).
        model: a LinkModel.
        max_cost: upper bound of the bone cost of one frame.
        bone_weight: weight of the bone cost; errors of this model persist over many frames.
        out: shape (frame, link), written.
    """
    links, length, length_sd, mean_cosine, mean_cosine_sd, joint_odds = model
    for t in range(points.shape[0]):
        for k in range(links.shape[0]):
            a, b = links[k, 0], links[k, 1]
            cost = _bone_cost(points[t, a], points[t, b], length[k], length_sd[k])
            cosine = _cosine(points[t, a], points[t, b])
            if not math.isnan(cosine):
                cost += 2.0 * cosine * mean_cosine[k] / mean_cosine_sd[k] ** 2
            cost = bone_weight * min(max(cost, -max_cost), max_cost)
            for v in range(odds.shape[2]):
                if joint_odds[k, v] > 0.0:
                    agreement = (
                        math.tanh(odds[t, a, v] / 2) * math.tanh(odds[t, b, v] / 2) * math.tanh(joint_odds[k, v] / 2)
                    )
                    cost += 2.0 * math.atanh(agreement)
            out[t, k] = cost
