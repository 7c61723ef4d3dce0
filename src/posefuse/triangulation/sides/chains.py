"""Limb by limb and over time: the default. See docs/methods.md, "Left and right"."""

import numpy as np

from posefuse.kernels.sides import all_time_costs, decide_block
from posefuse.model.side_options import SideOptions
from posefuse.triangulation.sides import evidence
from posefuse.triangulation.sides.layout import Layout
from posefuse.triangulation.sides.learning import Learned, Sequence, at_first, learn
from posefuse.triangulation.sides.results import PairsInTime, Sides
from posefuse.triangulation.sides.views import swapped_views


def decide(given: PairsInTime, options: SideOptions) -> Sides:
    """Decide every pair of every person, each person by itself.

    Args:
        given: the pairs of a recording, or of a stretch of it long enough to learn from (some seconds).
        options: of sides.
    """
    layout = Layout.of(given.skeleton)
    points = given.by_frame(given.pairs.points_m)
    flipped = np.zeros(points.shape[:3], dtype=bool)
    swapped = np.full((*points.shape[:2], len(given.rig), len(layout.chains)), -1, dtype=np.int8)
    for person in range(given.n_people):
        sequence = sequence_of(given, layout, person)
        flipped[:, person], learned = decide_person(sequence, layout, options)
        swapped[:, person] = swapped_views(sequence.ordered(flipped[:, person]), layout, learned)
    return Sides(flipped, swapped, layout.chains)


def sequence_of(given: PairsInTime, layout: Layout, person: int) -> Sequence:
    """One person's pairs in the order they came in."""
    frames = given.n_frames
    unpaired = np.full((frames, len(layout.unpaired), 3), np.nan)
    if given.midline_m is not None:
        unpaired = np.asarray(given.midline_m)[:, person, layout.unpaired]
    points = given.by_frame(given.pairs.points_m)[:, person]
    present = np.isfinite(points).all(axis=-1, keepdims=True)
    covariance = given.by_frame(given.pairs.covariance_m2)[:, person]
    return Sequence(
        points=np.ascontiguousarray(np.where(present, points, np.nan)),
        covariance=np.ascontiguousarray(np.where(present, covariance, np.nan)),
        odds=np.ascontiguousarray(given.by_frame(evidence.odds_of(given.pairs))[:, person]),
        time_s=np.asarray(given.time_s, dtype=np.float64),
        unpaired=unpaired,
    )


def decide_person(sequence: Sequence, layout: Layout, options: SideOptions) -> tuple[np.ndarray, Learned]:
    """Shape (frame, pair), bool: which pairs to exchange; and what was learned on the way."""
    flipped = np.zeros(sequence.points.shape[:2], dtype=bool)
    learned = at_first(sequence, layout, options)
    ordered = sequence
    for turn in range(1 + options.rounds):
        change = decode(ordered, layout, learned, decided=turn > 0)
        flipped ^= change
        ordered = sequence.ordered(flipped)
        learned = learn(ordered, layout, options)
    return flipped, learned


def decode(sequence: Sequence, layout: Layout, learned: Learned, *, decided: bool) -> np.ndarray:
    """Shape (frame, pair), bool: the most likely exchanges of a sequence, block by block.

    Args:
        sequence: in some order.
        layout: of its skeleton.
        learned: of its person and views.
        decided: whether that order is a decision; if not, blocks go by those before them only.
    """
    frames, pairs, views = sequence.odds.shape
    memory = evidence.Memory.empty(pairs, views)
    time_cost = np.empty((frames, pairs, 2, 2))
    all_time_costs(
        sequence.points, sequence.covariance, sequence.odds, sequence.time_s, *memory.arrays,
        *evidence.how_things_move(layout, learned), np.empty((2, 6)), time_cost,
    )  # fmt: skip
    field = evidence.fields(sequence, layout, learned)
    link_cost = evidence.links(sequence, layout, learned)
    out = np.zeros((frames, pairs), dtype=bool)
    known = np.full(pairs, decided)
    for block, (inside, ends) in zip(layout.blocks, layout.within, strict=True):
        told = field + from_other_blocks(link_cost, out, known, layout)
        n_states = 1 << len(block)
        origin = np.empty((frames, n_states), dtype=np.int64)
        decide_block(time_cost, told, link_cost, block, inside, ends, np.zeros(n_states), origin, out)
        known[block] = True
    return out


def from_other_blocks(link_cost: np.ndarray, flipped: np.ndarray, known: np.ndarray, layout: Layout) -> np.ndarray:
    """Shape (frame, pair): what exchanging a pair costs by its links to known pairs of other blocks, as these stand."""
    out = np.zeros(flipped.shape)
    for k in np.flatnonzero(layout.across):
        a, b = layout.links[k]
        for one, other in ((a, b), (b, a)):
            if known[other]:
                out[:, one] += np.where(flipped[:, other], -link_cost[:, k], link_cost[:, k])
    return out
