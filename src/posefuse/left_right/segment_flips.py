"""Exchange left and right for whole segments, because statistics estimated from an order cannot contradict that order.

If a pair is reversed in all frames, the bones and symmetry estimated from them agree with it, and no single frame has a
reason to change. Pairs and blocks are therefore also tried reversed in all frames at once, by cues that do not depend
on the order: labels, the generic body, and the side on which bones keep their length better.
"""

import numpy as np

from posefuse.left_right.costs import linkage_costs, symmetry_costs
from posefuse.left_right.estimates import SideModel, bone_spreads, with_generic_body
from posefuse.left_right.layout import Layout
from posefuse.left_right.person_sequence import PersonSequence

_VARIATION_WEIGHT = 0.35
_MAX_LOG_RATIO = 0.7


def flip_segments(sequence: PersonSequence, layout: Layout, model: SideModel, time_cost: np.ndarray) -> np.ndarray:
    """Return the pairs to exchange in all frames, shape (pair,), bool.

    Args:
        sequence: in the decided order.
        layout: of its skeleton.
        model: of its person and views.
        time_cost: shape (frame, pair, 2, 2), for that order: previous orientation, current orientation.
    """
    generic = with_generic_body(layout, model)
    pair_cost = (time_cost[:, :, 1, 1] - time_cost[:, :, 0, 0] + symmetry_costs(sequence, layout, generic)).sum(axis=0)
    link_cost = linkage_costs(sequence, layout, generic).sum(axis=0) + _length_variation_costs(sequence, layout)
    moves = _moves(layout)
    flipped = np.zeros(len(pair_cost), dtype=bool)
    for _ in range(2 * len(pair_cost)):
        costs = np.array([_cost(flipped ^ move, pair_cost, link_cost, layout) for move in moves])
        best = int(np.argmin(costs))
        if costs[best] >= _cost(flipped, pair_cost, link_cost, layout) - 1e-6:
            break
        flipped = flipped ^ moves[best]
    return flipped


def _moves(layout: Layout) -> np.ndarray:
    """Return the groups of pairs to exchange, shape (move, pair), bool: limbs, their outer parts, single pairs, all."""
    n = len(layout.chain_of)
    blocks = [block[j:] for block in layout.blocks for j in range(len(block))]
    groups = [*blocks, *(np.array([p]) for p in range(n)), np.arange(n)]
    return np.unique(np.array([np.isin(np.arange(n), move) for move in groups]), axis=0)


def _cost(flipped: np.ndarray, pair_cost: np.ndarray, link_cost: np.ndarray, layout: Layout) -> float:
    """Return the total cost of exchanging some pairs."""
    differing = flipped[layout.links[:, 0]] != flipped[layout.links[:, 1]]
    return float(pair_cost[flipped].sum() + link_cost[differing].sum())


def _length_variation_costs(sequence: PersonSequence, layout: Layout) -> np.ndarray:
    """Return the cost, shape (link,), of exchanging one of two pairs by the variation of bone lengths."""
    as_ordered, exchanged, known = bone_spreads(sequence, layout)
    ratio = np.log(exchanged / as_ordered)
    return _VARIATION_WEIGHT * known * np.clip(ratio, -_MAX_LOG_RATIO, _MAX_LOG_RATIO)
