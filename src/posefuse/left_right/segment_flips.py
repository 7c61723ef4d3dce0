"""Exchanges for the whole of a stretch: what was learned from an order cannot speak against that order.

If a pair is the wrong way round in all frames, bones and symmetry learned from them say that this is how the body is,
and no frame has reason to change. So pairs and blocks are also tried the other way round in all frames at once, on what
does not depend on the order: labels, what is expected of any body, and on which side bones keep their length better.
"""

import numpy as np

from posefuse.left_right import costs as cost_terms
from posefuse.left_right.estimates import Learned, expected, spreads
from posefuse.left_right.layout import Layout
from posefuse.left_right.sequence import Sequence

_SPREADS_COUNT = 0.35
_LOG_RATIO_AT_MOST = 0.7


def settle(sequence: Sequence, layout: Layout, learned: Learned, time_cost: np.ndarray) -> np.ndarray:
    """Shape (pair,), bool: which pairs to exchange in all frames.

    Args:
        sequence: in the order decided on.
        layout: of its skeleton.
        learned: of its person and views.
        time_cost: shape (frame, pair, 2, 2), of that order: orientation before, orientation now.
    """
    any_body = expected(layout, learned)
    field = (time_cost[:, :, 1, 1] - time_cost[:, :, 0, 0] + cost_terms.fields(sequence, layout, any_body)).sum(axis=0)
    link = cost_terms.links(sequence, layout, any_body).sum(axis=0) + _by_spread(sequence, layout)
    moves = _moves(layout)
    flipped = np.zeros(len(field), dtype=bool)
    for _ in range(2 * len(field)):
        costs = np.array([_cost(flipped ^ move, field, link, layout) for move in moves])
        best = int(np.argmin(costs))
        if costs[best] >= _cost(flipped, field, link, layout) - 1e-6:
            break
        flipped = flipped ^ moves[best]
    return flipped


def _moves(layout: Layout) -> np.ndarray:
    """Shape (move, pair), bool, the pairs that are tried together: limbs, limbs from some joint on, pairs, all."""
    n = len(layout.chain_of)
    blocks = [block[j:] for block in layout.blocks for j in range(len(block))]
    tried = [*blocks, *(np.array([p]) for p in range(n)), np.arange(n)]
    return np.unique(np.array([np.isin(np.arange(n), move) for move in tried]), axis=0)


def _cost(flipped: np.ndarray, field: np.ndarray, link: np.ndarray, layout: Layout) -> float:
    apart = flipped[layout.links[:, 0]] != flipped[layout.links[:, 1]]
    return float(field[flipped].sum() + link[apart].sum())


def _by_spread(sequence: Sequence, layout: Layout) -> np.ndarray:
    """Shape (link,): what exchanging one of two pairs costs in all frames, by how well the bone keeps its length."""
    kept, exchanged, known = spreads(sequence, layout)
    ratio = np.log(exchanged / kept)
    return _SPREADS_COUNT * known * np.clip(ratio, -_LOG_RATIO_AT_MOST, _LOG_RATIO_AT_MOST)
