"""Limb by limb and over time: the default. See docs/methods.md, "Left and right"."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.kernels.left_right.orientation import add_cross_links, find_orientations, temporal_costs
from posefuse.left_right import costs as cost_terms
from posefuse.left_right.costs import Memory
from posefuse.left_right.estimates import Learned, at_first, learn
from posefuse.left_right.layout import Layout
from posefuse.left_right.results import PairsInTime, Sides
from posefuse.left_right.segment_flips import settle
from posefuse.left_right.sequence import Sequence
from posefuse.left_right.view_swaps import swapped_views
from posefuse.model.options.left_right import SideOptions


def decide(given: PairsInTime, options: SideOptions) -> Sides:
    """Decide every pair of every person, each person by itself.

    Args:
        given: the pairs of a recording, or of a stretch of it long enough to learn from (some seconds).
        options: of sides.
    """
    layout = Layout.of(given.skeleton)
    shape = (given.n_frames, given.n_people)
    flipped = np.zeros((*shape, len(layout.chain_of)), dtype=bool)
    swapped = np.full((*shape, len(given.rig), len(layout.chains)), -1, dtype=np.int8)
    for person in range(given.n_people):
        sequence = Sequence.of(given, layout, person)
        flipped[:, person], learned = decide_person(sequence, layout, options)
        swapped[:, person] = swapped_views(sequence.ordered(flipped[:, person]), layout, learned)
    return Sides(flipped, swapped, layout.chains)


def decide_person(sequence: Sequence, layout: Layout, options: SideOptions) -> tuple[np.ndarray, Learned]:
    """Shape (frame, pair), bool: which pairs to exchange; and what was learned on the way."""
    flipped = np.zeros(sequence.points.shape[:2], dtype=bool)
    learned = at_first(sequence, layout, options)
    ordered = sequence
    for turn in range(1 + options.iterations):
        change = decode(ordered, layout, learned, Before.nothing(layout, len(learned.share)), decided=turn > 0)
        change = settled(ordered, change, layout, learned)
        flipped ^= change
        ordered = sequence.ordered(flipped)
        learned = learn(ordered, layout, options)
        if turn > 0 and not change.any():
            break
    return flipped, learned


def settled(sequence: Sequence, flipped: np.ndarray, layout: Layout, learned: Learned) -> np.ndarray:
    """Shape (frame, pair): a decision on a sequence, put right where all of it is better the other way round."""
    ordered = sequence.ordered(flipped)
    memory = Memory.empty(len(layout.chain_of), len(learned.share))
    return flipped ^ settle(ordered, layout, learned, time_costs_of(ordered, layout, learned, memory))


@dataclass(frozen=True, eq=False)
class Before:
    """What came before a stretch of frames; decoding goes on from it and writes what comes after into it.

    Attributes:
        memory: what was seen last.
        costs: of each block, shape (2^J,): what its orientations cost so far, against the order decided on.
    """

    memory: Memory
    costs: tuple[np.ndarray, ...]

    @classmethod
    def nothing(cls, layout: Layout, n_views: int) -> Self:
        """The beginning."""
        memory = Memory.empty(len(layout.chain_of), n_views)
        return cls(memory, tuple(np.zeros(1 << len(block)) for block in layout.blocks))

    def copy(self) -> Self:
        """Another of the same."""
        return type(self)(self.memory.copy(), tuple(costs.copy() for costs in self.costs))


def decode(sequence: Sequence, layout: Layout, learned: Learned, before: Before, *, decided: bool) -> np.ndarray:
    """Shape (frame, pair), bool: the most likely exchanges of a sequence, block by block.

    Args:
        sequence: in some order.
        layout: of its skeleton.
        learned: of its person and views.
        before: written: costs after the last frame, memory in the sequence's order.
        decided: whether that order is a decision. If not, blocks are decided twice: first each by itself and by those
            before it, then told of all others.
    """
    time_cost = time_costs_of(sequence, layout, learned, before.memory)
    field = cost_terms.fields(sequence, layout, learned)
    link_cost = cost_terms.links(sequence, layout, learned)
    out = np.zeros(field.shape, dtype=bool)
    known, told = np.full(field.shape[1], decided), np.empty_like(field)
    for last in (True,) if decided else (False, True):
        for block, (inside, ends), start in zip(layout.blocks, layout.within, before.costs, strict=True):
            costs = start if last else start.copy()
            add_cross_links(field, link_cost, layout.links, layout.across, out, known, told)
            origin = np.empty((len(field), len(costs)), dtype=np.int64)
            find_orientations(time_cost, told, link_cost, block, inside, ends, costs, origin, out)
            known[block] = True
    return out


def time_costs_of(sequence: Sequence, layout: Layout, learned: Learned, memory: Memory) -> np.ndarray:
    """Shape (frame, pair, 2, 2): what orientations cost, given those before; ``memory`` is written."""
    frames, pairs, _ = sequence.odds.shape
    out = np.empty((frames, pairs, 2, 2))
    speeds = learned.turn_speed, learned.speed
    views = learned.share, learned.rate, cost_terms.label_weights(layout, learned)
    frame = sequence.points, np.ascontiguousarray(sequence.covariance), sequence.odds, sequence.time_s
    temporal_costs(*frame, memory.arrays, speeds, views, np.empty((2, 6)), out)
    return out
