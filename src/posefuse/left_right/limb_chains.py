"""Assign left and right per limb and over time, the default method. See docs/methods."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.kernels.left_right.orientation import add_cross_links, find_orientations, temporal_costs
from posefuse.kernels.left_right.records import LabelModel, MotionSpeeds, OrientationCosts, PairBlock, PairFrames
from posefuse.left_right.costs import LastObservations, label_weights, linkage_costs, symmetry_costs
from posefuse.left_right.estimates import SideModel, estimate_model, initial_model
from posefuse.left_right.layout import Layout
from posefuse.left_right.person_sequence import PersonSequence
from posefuse.left_right.results import PairSequence, SideAssignment
from posefuse.left_right.segment_flips import flip_segments
from posefuse.left_right.view_swaps import find_view_swaps
from posefuse.model.options.left_right import SideOptions


def assign(pairs: PairSequence, options: SideOptions) -> SideAssignment:
    """Assign left and right for every person independently.

    Args:
        pairs: of a recording, or of a part long enough to estimate from (some seconds).
        options: of the method.
    """
    layout = Layout.of(pairs.skeleton)
    shape = (pairs.n_frames, pairs.n_people)
    flipped = np.zeros((*shape, len(layout.chain_of)), dtype=bool)
    swapped = np.full((*shape, len(pairs.rig), len(layout.chains)), -1, dtype=np.int8)
    for person in range(pairs.n_people):
        sequence = PersonSequence.of(pairs, layout, person)
        flipped[:, person], model = assign_person(sequence, layout, options)
        swapped[:, person] = find_view_swaps(sequence.ordered(flipped[:, person]), layout, model)
    return SideAssignment(flipped, swapped, layout.chains)


def assign_person(sequence: PersonSequence, layout: Layout, options: SideOptions) -> tuple[np.ndarray, SideModel]:
    """Return which pairs to exchange, shape (frame, pair), bool, and the estimated model."""
    flipped = np.zeros(sequence.points.shape[:2], dtype=bool)
    model = initial_model(sequence, layout, options)
    ordered = sequence
    for iteration in range(1 + options.iterations):
        change = decode(
            ordered, layout, model, DecoderState.initial(layout, len(model.swap_share)), decided=iteration > 0
        )
        change = with_segment_flips(ordered, change, layout, model)
        flipped ^= change
        ordered = sequence.ordered(flipped)
        model = estimate_model(ordered, layout, options)
        if iteration > 0 and not change.any():
            break
    return flipped, model


def with_segment_flips(sequence: PersonSequence, flipped: np.ndarray, layout: Layout, model: SideModel) -> np.ndarray:
    """Return an assignment (frame, pair) with pairs exchanged in all frames where that costs less overall."""
    ordered = sequence.ordered(flipped)
    memory = LastObservations.empty(len(layout.chain_of), len(model.swap_share))
    return flipped ^ flip_segments(ordered, layout, model, temporal_pair_costs(ordered, layout, model, memory))


@dataclass(frozen=True, eq=False)
class DecoderState:
    """Hold the state of decoding before a range of frames; decoding continues from it and updates it.

    Attributes:
        memory: last observations.
        costs: for each block, shape (2^J,): accumulated cost of each orientation, relative to the decided order.
    """

    memory: LastObservations
    costs: tuple[np.ndarray, ...]

    @classmethod
    def initial(cls, layout: Layout, n_views: int) -> Self:
        """Return the state before the first frame."""
        memory = LastObservations.empty(len(layout.chain_of), n_views)
        return cls(memory, tuple(np.zeros(1 << len(block)) for block in layout.blocks))


def decode(
    sequence: PersonSequence, layout: Layout, model: SideModel, before: DecoderState, *, decided: bool
) -> np.ndarray:
    """Return the most likely exchanges of a sequence, shape (frame, pair), bool, block by block.

    Args:
        sequence: in some order.
        layout: of its skeleton.
        model: of its person and views.
        before: state before the first frame; updated to that after the last frame, in the sequence's order.
        decided: whether the order is a decision. If not, blocks are decided twice: first from themselves and the blocks
            before them, then from all others.
    """
    time_cost = temporal_pair_costs(sequence, layout, model, before.memory)
    pair_cost = symmetry_costs(sequence, layout, model)
    link_cost = linkage_costs(sequence, layout, model)
    out = np.zeros(pair_cost.shape, dtype=bool)
    decided_pairs, pair_cost_now = np.full(pair_cost.shape[1], decided), np.empty_like(pair_cost)
    for final in (True,) if decided else (False, True):
        for block, (inside, ends), start in zip(layout.blocks, layout.within, before.costs, strict=True):
            costs = start if final else start.copy()
            add_cross_links(pair_cost, link_cost, layout.links, layout.across, out, decided_pairs, pair_cost_now)
            origin = np.empty((len(pair_cost), len(costs)), dtype=np.int64)
            orientation_costs = OrientationCosts(time_cost, pair_cost_now, link_cost)
            find_orientations(orientation_costs, PairBlock(block, inside, ends), costs, origin, out)
            decided_pairs[block] = True
    return out


def temporal_pair_costs(
    sequence: PersonSequence, layout: Layout, model: SideModel, memory: LastObservations
) -> np.ndarray:
    """Return the cost of each orientation given the previous one, shape (frame, pair, 2, 2); updates ``memory``."""
    frames, pairs, _ = sequence.odds.shape
    out = np.empty((frames, pairs, 2, 2))
    speeds = MotionSpeeds(model.turn_speed, model.speed)
    labels = LabelModel(model.swap_share, model.forgetting_rate, label_weights(layout, model))
    part = PairFrames(sequence.points, np.ascontiguousarray(sequence.covariance), sequence.odds, sequence.time_s)
    temporal_costs(part, memory.arrays, speeds, labels, np.empty((2, 6)), out)
    return out
