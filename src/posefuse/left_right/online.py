"""The method ``chains`` forward only, a frame at a time, for live use.

A decision rests on what came before and is not taken back. What is learned is learned from the last frames, in the
order decided on; then these frames are decided anew, so that an early mistake does not teach later ones.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.kernels.left_right.orientation import update_memory
from posefuse.left_right.costs import Memory
from posefuse.left_right.estimates import Learned, at_first, learn
from posefuse.left_right.layout import Layout
from posefuse.left_right.limb_chains import Before, decode, settled
from posefuse.left_right.results import PairsInTime, Sides
from posefuse.left_right.sequence import Sequence
from posefuse.left_right.view_swaps import swapped_views
from posefuse.model.options.left_right import SideOptions
from posefuse.skeleton.skeletons import Skeleton

_EARLY = (5, 10, 15, 20, 25)
_SWAPS_FROM = 30
"""A view's swaps are decided on so many frames back to now."""


@dataclass(frozen=True, eq=False)
class OnlineSides:
    """What one person's frames so far leave behind; never written to.

    Attributes:
        layout: of the skeleton.
        options: of sides.
        before: costs and memory, in the order decided on; None before the first frame.
        learned: of the person and the views; None before the first frame.
        recent: the last frames, in the order decided on.
        n_frames: how many there were.
    """

    layout: Layout
    options: SideOptions
    before: Before | None = None
    learned: Learned | None = None
    recent: Sequence | None = None
    n_frames: int = 0

    @classmethod
    def start(cls, skeleton: Skeleton, options: SideOptions | None = None) -> "OnlineSides":
        """Of one person, before the first frame."""
        return cls(Layout.of(skeleton), options or SideOptions())


def advance(state: OnlineSides, frame: PairsInTime) -> tuple[OnlineSides, Sides]:
    """Decide a frame of one person.

    Args:
        state: what the frames before left behind.
        frame: pairs of one frame and one person, later than those before.
    """
    layout, now = state.layout, Sequence.of(frame, state.layout, 0)
    learned = state.learned or at_first(now, layout, state.options)
    before = state.before or Before.nothing(layout, now.odds.shape[2])
    flipped, before = _decide(now, layout, learned, before)
    ordered = now.ordered(flipped)
    recent = ordered if state.recent is None else Sequence.concatenate([state.recent, ordered])
    recent = recent.frames(max(0, len(recent.time_s) - state.options.memory), len(recent.time_s))
    n_frames = state.n_frames + 1
    if n_frames in _EARLY or n_frames % state.options.learn_every == 0:
        change, learned, before = _decide_again(recent, layout, learned, state.options)
        recent, flipped = recent.ordered(change), flipped ^ change[-1:]
    latest = recent.frames(max(0, len(recent.time_s) - _SWAPS_FROM), len(recent.time_s))
    swapped = swapped_views(latest, layout, learned)[-1:, None]
    after = replace(state, before=before, learned=learned, recent=recent, n_frames=n_frames)
    return after, Sides(flipped[:, None], swapped, layout.chains)


def _decide(now: Sequence, layout: Layout, learned: Learned, before: Before) -> tuple[np.ndarray, Before]:
    """Shape (1, pair), bool: which pairs of a frame to exchange; and what it leaves behind, in that order."""
    after = before.copy()
    flipped = decode(now, layout, learned, after, decided=False)
    return flipped, Before(_with(before.memory, now.ordered(flipped)), _reordered(after.costs, layout, flipped[-1]))


def _decide_again(
    recent: Sequence, layout: Layout, learned: Learned, options: SideOptions
) -> tuple[np.ndarray, Learned, Before]:
    """The same of all frames remembered, shape (frame, pair), with what is learned from them."""
    as_they_are = np.zeros(recent.points.shape[:2], dtype=bool)
    whole = settled(recent, as_they_are, layout, learned)
    ordered = recent.ordered(whole)
    learned = learn(ordered, layout, options)
    n_views = recent.odds.shape[2]
    after = Before.nothing(layout, n_views)
    change = decode(ordered, layout, learned, after, decided=True)
    memory = _with(Memory.empty(len(layout.chain_of), n_views), ordered.ordered(change))
    return whole ^ change, learned, Before(memory, _reordered(after.costs, layout, change[-1]))


def _with(memory: Memory, ordered: Sequence) -> Memory:
    """What is remembered after frames in the order decided on."""
    out = memory.copy()
    update_memory(ordered.points, ordered.covariance, ordered.odds, ordered.time_s, out.arrays)
    return out


def _reordered(costs: tuple[np.ndarray, ...], layout: Layout, flipped: np.ndarray) -> tuple[np.ndarray, ...]:
    """Costs of orientations against another order: that with the pairs exchanged that ``flipped`` (pair,) says."""
    out = []
    for block, of in zip(layout.blocks, costs, strict=True):
        bits = int((flipped[block] << np.arange(len(block))).sum())
        out.append(of[np.arange(len(of)) ^ bits])
    return tuple(out)
