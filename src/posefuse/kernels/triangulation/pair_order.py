"""Which pairs of views the search of :mod:`posefuse.kernels.triangulation.pair_search` tries, and when it has tried enough."""

import math
from functools import cache
from itertools import combinations

import numpy as np

_ALL_PAIRS_UP_TO = 12
_PAIRS_PER_VIEW = 8
_MISSED = 1e-4
"""How likely it may be that no pair of agreeing views was among those tried when the search ends early."""
_MISSED_DECIDED = 0.05
"""The same where so many agree that the best would share three views with them, and so be their point."""


@cache
def pairs_to_try(n_views: int) -> np.ndarray:
    """Shape (pair, 2), int64: pairs of ranks, best first; all of them up to 12 views, 8 a view beyond."""
    pairs = sorted(combinations(range(n_views), 2), key=lambda pair: (sum(pair), pair))
    most = len(pairs) if n_views <= _ALL_PAIRS_UP_TO else _PAIRS_PER_VIEW * n_views
    return np.array(pairs[:most], dtype=np.int64)


@cache
def enough_tries(n_views: int) -> np.ndarray:
    """Shape (view + 1, view + 1), int64: with n views of which m agree, how many pairs need to be tried.

    If m views are right, a pair is right with probability ``m (m - 1) / (n (n - 1))``; the search may end when it is
    certain enough that a right one was tried. With all views in agreement one is. As many others as agree, or more,
    share ``2 m - n`` views with them: where these are three there is no other point to be found, only a better start.
    """
    table = np.zeros((n_views + 1, n_views + 1), dtype=np.int64)
    for n in range(2, n_views + 1):
        every = math.comb(n, 2)
        table[n, :2] = every
        table[n, n] = 1
        for m in range(2, n):
            share = m * (m - 1) / (n * (n - 1))
            missed = _MISSED_DECIDED if decided(n, m) else _MISSED
            table[n, m] = min(every, math.ceil(math.log(missed) / math.log1p(-share)))
    return table


def decided(n_views: int, agreeing: int) -> bool:
    """Whether any rival of a point must share three views with it."""
    return 2 * agreeing - n_views >= 3


def brief_tries(n_views: int) -> int:
    """After how many pairs a point of all views is found if it is decided by as few as can; 0 if only all can."""
    least = (n_views + 4) // 2
    return int(enough_tries(n_views)[n_views, least]) if least < n_views else 0
