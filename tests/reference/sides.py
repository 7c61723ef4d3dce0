"""Left/right assignment by exhaustive search over orientation sequences."""

from itertools import product

import numpy as np


def cheapest(time_cost, field, link_cost, members, links, link_ends) -> tuple[float, np.ndarray]:
    """Return the lowest cost over all orientation sequences of a block, and the sequence, shape (frame, J)."""
    frames, width = len(field), len(members)
    best, chosen = np.inf, np.zeros((frames, width), dtype=bool)
    for bits in product(range(2), repeat=frames * width):
        state = np.array(bits).reshape(frames, width)
        cost = cost_of(state, time_cost, field, link_cost, members, links, link_ends)
        if cost < best - 1e-12:
            best, chosen = cost, state.astype(bool)
    return best, chosen


def cost_of(state, time_cost, field, link_cost, members, links, link_ends) -> float:
    """Return the cost of one sequence; before the first frame every orientation is free."""
    total = 0.0
    for t, now in enumerate(state):
        for j, p in enumerate(members):
            before = time_cost[t, p, :, now[j]]
            total += before.min() if t == 0 else before[state[t - 1, j]]
            total += field[t, p] * now[j]
        for k, (a, b) in zip(links, link_ends, strict=True):
            total += link_cost[t, k] * (now[a] != now[b])
    return float(total)


def cheapest_swaps(odds, time_s, share, rate) -> np.ndarray:
    """Return the likeliest states of one view, shape (frame,)."""
    best, chosen = np.inf, np.zeros(len(odds), dtype=int)
    for states in product(range(2), repeat=len(odds)):
        cost = -np.log(share if states[0] else 1.0 - share)
        for t, state in enumerate(states):
            cost += 0.5 * odds[t] * (-1 if state else 1)
            if t:
                forgotten = 1.0 - np.exp(-rate * (time_s[t] - time_s[t - 1]))
                stationary = share if state else 1.0 - share
                cost -= np.log((1.0 - forgotten) * (state == states[t - 1]) + forgotten * stationary)
        if cost < best - 1e-12:
            best, chosen = cost, np.array(states)
    return chosen


def turn_cost(points, covariance, then, then_covariance, spread, nu=4.0, most=12.0) -> float:
    """Return the cost of exchanging two points over keeping them, from the vector between them."""
    both = sum(full(c) for c in (*covariance, *then_covariance)) + spread * np.eye(3)
    d, e = points[1] - points[0], then[1] - then[0]
    kept, exchanged = ((d - s * e) @ np.linalg.solve(both, d - s * e) for s in (1.0, -1.0))
    cost = 0.5 * (nu + 3) * (np.log1p(exchanged / nu) - np.log1p(kept / nu))
    return float(np.clip(cost, -most, most))


def full(entries) -> np.ndarray:
    """Return a symmetric matrix from xx xy xz yy yz zz."""
    return np.asarray(entries)[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


def label_cost(now, then, since_s, share, rate) -> np.ndarray:
    """Return the cost of the labels of a view for each orientation before and now, shape (2, 2)."""
    forgotten = 1.0 - np.exp(-rate * since_s)
    stationary = np.array([1.0 - share, share])
    out = np.empty((2, 2))
    for b, c in product(range(2), repeat=2):
        likelihood = 0.0
        for was, is_now in product(range(2), repeat=2):
            p_was = 1.0 / (1.0 + np.exp(-then if was ^ b else then))
            p_now = 1.0 / (1.0 + np.exp(-now if is_now ^ c else now))
            passed = (1.0 - forgotten) * (was == is_now) + forgotten * stationary[is_now]
            likelihood += p_was * p_now * passed
        out[b, c] = -np.log(likelihood)
    return out
