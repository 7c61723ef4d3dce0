"""Determine which views swap the labels of which chain, from an assignment of left and right."""

import numpy as np

from posefuse.kernels.left_right.orientation import find_swap_states
from posefuse.left_right.estimates import SideModel, estimate_model
from posefuse.left_right.layout import Layout
from posefuse.left_right.person_sequence import PersonSequence
from posefuse.left_right.results import PairSequence
from posefuse.model.options.left_right import SideOptions

_MIN_LOG_ODDS = 0.5
"""Smallest log odds of a decisive label."""


def view_swap_states(sequence: PairSequence, flipped: np.ndarray, layout: Layout, options: SideOptions) -> np.ndarray:
    """Return swap states (frame, person, view, chain), int8, for an assignment (frame, person, pair)."""
    out = np.empty((*flipped.shape[:2], len(sequence.rig), len(layout.chains)), dtype=np.int8)
    for person in range(sequence.n_people):
        ordered = PersonSequence.of(sequence, layout, person).ordered(flipped[:, person])
        out[:, person] = find_view_swaps(ordered, layout, estimate_model(ordered, layout, options))
    return out


def find_view_swaps(sequence: PersonSequence, layout: Layout, model: SideModel) -> np.ndarray:
    """Return swap states, shape (frame, view, chain), int8: 1 swapped, 0 as labeled, -1 without a decisive observation.

    Args:
        sequence: in the decided order.
        layout: of its skeleton.
        model: how often each view swaps, and how long swaps last.
    """
    frames, _, views = sequence.odds.shape
    out = np.empty((frames, views, len(layout.chains)), dtype=np.int8)
    state, predecessor = np.empty((frames, views), dtype=np.int8), np.empty((frames, 2), dtype=np.int64)
    for chain in range(len(layout.chains)):
        members = layout.chain_of == chain
        odds = np.ascontiguousarray(sequence.odds[:, members].sum(axis=1))
        find_swap_states(odds, sequence.time_s, model.swap_share, model.forgetting_rate, predecessor, state)
        decisive = np.abs(sequence.odds[:, members]).max(axis=1) > _MIN_LOG_ODDS
        out[:, :, chain] = np.where(decisive, state, -1)
    return out
