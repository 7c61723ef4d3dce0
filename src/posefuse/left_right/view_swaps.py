"""What a decision on sides says about the views: whose labels of which chain were swapped."""

import numpy as np

from posefuse.kernels.left_right.orientation import find_swap_states
from posefuse.left_right.estimates import Learned, learn
from posefuse.left_right.layout import Layout
from posefuse.left_right.results import PairsInTime
from posefuse.left_right.sequence import Sequence
from posefuse.model.options.left_right import SideOptions

_TELLS = 0.5


def views_of(given: PairsInTime, flipped: np.ndarray, layout: Layout, options: SideOptions) -> np.ndarray:
    """Shape (frame, person, view, chain), int8, of a decision (frame, person, pair); see :func:`swapped_views`."""
    out = np.empty((*flipped.shape[:2], len(given.rig), len(layout.chains)), dtype=np.int8)
    for person in range(given.n_people):
        ordered = Sequence.of(given, layout, person).ordered(flipped[:, person])
        out[:, person] = swapped_views(ordered, layout, learn(ordered, layout, options))
    return out


def swapped_views(sequence: Sequence, layout: Layout, learned: Learned) -> np.ndarray:
    """Shape (frame, view, chain), int8: 1 swapped, 0 as labelled, -1 where the view saw nothing that tells.

    Args:
        sequence: in the order decided on.
        layout: of its skeleton.
        learned: how often each view swaps, and how long swaps last.
    """
    frames, _, views = sequence.odds.shape
    out = np.empty((frames, views, len(layout.chains)), dtype=np.int8)
    state, came_from = np.empty((frames, views), dtype=np.int8), np.empty((frames, 2), dtype=np.int64)
    for chain in range(len(layout.chains)):
        members = layout.chain_of == chain
        odds = np.ascontiguousarray(sequence.odds[:, members].sum(axis=1))
        find_swap_states(odds, sequence.time_s, learned.share, learned.rate, came_from, state)
        tells = np.abs(sequence.odds[:, members]).max(axis=1) > _TELLS
        out[:, :, chain] = np.where(tells, state, -1)
    return out
