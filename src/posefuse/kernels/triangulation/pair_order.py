"""The order in which :mod:`posefuse.kernels.triangulation.pair_search` tries pairs of views, and when it may stop."""

import math
from functools import cache
from itertools import combinations

import numpy as np

_ALL_PAIRS_UP_TO = 12
_PAIRS_PER_VIEW = 8
_MISS_PROBABILITY = 1e-4
"""Accepted probability that no pair of agreeing views was tried before an early stop."""
_MISS_PROBABILITY_DECIDED = 0.05
"""The same if any better point would share three of the agreeing views, and so be the same point."""


@cache
def ordered_pairs(n_views: int) -> np.ndarray:
    """Return pairs of ranks, best first, shape (pair, 2), int64: all pairs up to 12 views, 8 per view beyond."""
    pairs = sorted(combinations(range(n_views), 2), key=lambda pair: (sum(pair), pair))
    limit = len(pairs) if n_views <= _ALL_PAIRS_UP_TO else _PAIRS_PER_VIEW * n_views
    return np.array(pairs[:limit], dtype=np.int64)


@cache
def required_tries(n_views: int) -> np.ndarray:
    """Return the number of pairs to try with n views of which m agree, shape (view + 1, view + 1), int64.

    If m views are inliers, a pair consists of inliers with probability ``m (m - 1) / (n (n - 1))``. The search may stop
    once the probability that no such pair was tried is small enough. If all views agree, one pair suffices. Any
    competing point with at least as many views shares ``2 m - n`` views with the inliers. If these are three or more,
    the competitor is the same point with a better start.
    """
    table = np.zeros((n_views + 1, n_views + 1), dtype=np.int64)
    for n in range(2, n_views + 1):
        all_pairs = math.comb(n, 2)
        table[n, :2] = all_pairs
        table[n, n] = 1
        for m in range(2, n):
            probability = m * (m - 1) / (n * (n - 1))
            miss_probability = _MISS_PROBABILITY_DECIDED if is_decided(n, m) else _MISS_PROBABILITY
            table[n, m] = min(all_pairs, math.ceil(math.log(miss_probability) / math.log1p(-probability)))
    return table


def is_decided(n_views: int, agreeing: int) -> bool:
    """Return whether any competing point must share three views with the current one."""
    return 2 * agreeing - n_views >= 3


def early_limit(n_views: int) -> int:
    """Return the number of pairs after which the fewest views that can decide a point do; 0 if all views are needed."""
    fewest = (n_views + 4) // 2
    return int(required_tries(n_views)[n_views, fewest]) if fewest < n_views else 0
