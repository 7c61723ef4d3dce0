"""What a decision on sides learns from the recording itself: how it moves, its bones, its symmetry, its views.

Nothing here is told of a particular body. Each number is a robust estimate over the frames in the order decided on so
far; while most of that order is right, so is the estimate, and the next decision is better.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from posefuse.left_right.layout import Layout
from posefuse.left_right.sequence import Sequence
from posefuse.model.options.left_right import SideOptions

_FRAMES = 300
_TRIPLES = 3
_NOT_SURE_OF = 30.0
"""An average over n frames is taken for n / (n + 30) of itself, a spread for (n + 30) / n of itself."""
_LEAST_SD = 0.2
_LIKENESS_OF_TRUNK, _LIKENESS_SD = 0.6, 0.5
_ALONG_BY_FACING, _ALONG_SD = 0.45, 0.35
_EXPECTED_FRAMES = 60.0
"""What is expected of any body is given up for what is seen after so many frames."""


@dataclass(frozen=True, eq=False)
class Learned:
    """What is known of a person and of the views.

    Attributes:
        turn_speed: shape (pair,): how fast the vector between the two points changes, m/s per axis.
        speed: shape (pair,): how fast a point moves, m/s per axis.
        length, length_sd: shape (link,): of the bone between two pairs, m.
        likeness, likeness_sd: shape (link,): of the cosine between the vectors of two pairs.
        triples: shape (pair, T, 3), int64: points of the midline, whose plane's normal the pair lies along.
        along, along_sd: shape (pair, T): of how far it does, -1 to 1.
        share: shape (view,): of the time that labels are swapped.
        rate: shape (view,): how fast a view forgets that they are, 1/s.
        alike: shape (view,): correlation of the labels within a chain.
    """

    turn_speed: np.ndarray
    speed: np.ndarray
    length: np.ndarray
    length_sd: np.ndarray
    likeness: np.ndarray
    likeness_sd: np.ndarray
    triples: np.ndarray
    along: np.ndarray
    along_sd: np.ndarray
    share: np.ndarray
    rate: np.ndarray
    alike: np.ndarray


def at_first(sequence: Sequence, layout: Layout, options: SideOptions) -> Learned:
    """What is known before any decision: how things move, what any body is like, and of views what the options say."""
    links, views = len(layout.links), sequence.odds.shape[2]
    turn_speed, speed = speeds(sequence)
    triples, along, along_sd = _expected_symmetry(layout)
    return Learned(
        turn_speed=turn_speed,
        speed=speed,
        length=np.zeros(links),
        length_sd=np.full(links, 1e6),
        likeness=_expected_likeness(layout),
        likeness_sd=np.full(links, _LIKENESS_SD),
        triples=triples,
        along=along,
        along_sd=along_sd,
        share=np.full(views, options.swap_share),
        rate=np.full(views, 1.0 / (options.swap_duration_s * (1.0 - options.swap_share))),
        alike=np.full(views, 0.5),
    )


def expected(layout: Layout, learned: Learned) -> Learned:
    """The same of movements and views, but of the body only what any body is like."""
    links = len(layout.links)
    triples, along, along_sd = _expected_symmetry(layout)
    return replace(
        learned,
        length=np.zeros(links),
        length_sd=np.full(links, 1e6),
        likeness=_expected_likeness(layout),
        likeness_sd=np.full(links, _LIKENESS_SD),
        triples=triples,
        along=along,
        along_sd=along_sd,
    )


def _expected_likeness(layout: Layout) -> np.ndarray:
    """Shape (link,): hips and shoulders point the same way; of other bones nothing is expected."""
    return np.where(layout.trunk[layout.links].all(axis=1), _LIKENESS_OF_TRUNK, 0.0)


def _expected_symmetry(layout: Layout) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each pair the triple of shoulders, hips and nose, which tells the trunk's sides."""
    n_pairs, n_triples = len(layout.chain_of), int(len(layout.facing) > 0)
    triples = np.tile(layout.facing.reshape(n_triples, 3), (n_pairs, 1, 1))
    along = np.tile(np.where(layout.trunk, _ALONG_BY_FACING, 0.0)[:, None], (1, n_triples))
    return triples, along, np.full((n_pairs, n_triples), _ALONG_SD)


def learn(sequence: Sequence, layout: Layout, options: SideOptions) -> Learned:
    """From frames in the order decided on."""
    share, rate, alike = _views(sequence, layout, options)
    turn_speed, speed = speeds(sequence)
    length, length_sd, likeness, likeness_sd = _links(sequence, layout)
    triples, along, along_sd = _symmetry(sequence, layout)
    return Learned(
        turn_speed, speed, length, length_sd, likeness, likeness_sd, triples, along, along_sd, share, rate, alike
    )


def speeds(sequence: Sequence) -> tuple[np.ndarray, np.ndarray]:
    """Shape (pair,), twice: how fast the vector between two points and the points change, whichever is which."""
    dt = np.diff(sequence.time_s)[:, None]
    across, middle = sequence.across, sequence.points.mean(axis=2)
    noise = sequence.covariance[..., [0, 3, 5]].sum(axis=(-1, -2))
    noise = noise[1:] + noise[:-1]
    turned = np.minimum(
        np.square(across[1:] - across[:-1]).sum(axis=-1), np.square(across[1:] + across[:-1]).sum(axis=-1)
    )
    moved = np.square(np.diff(middle, axis=0)).sum(axis=-1)
    size = _percentile(np.linalg.norm(across, axis=-1), 50, 0.1)
    turn = _percentile(np.sqrt(np.maximum(turned - noise, 0.0) / 3.0) / dt, 80, 1.0)
    move = _percentile(np.sqrt(np.maximum(moved - 0.25 * noise, 0.0) / 3.0) / dt, 80, 1.0)
    turn = np.maximum(turn, 0.5 * size)
    return turn, np.maximum(np.hypot(move, 0.5 * turn), 0.5 * size)


def along_normals(sequence: Sequence, layout: Layout, triples: np.ndarray) -> np.ndarray:
    """Shape (frame, pair, T): how far each pair lies along the normal of its triples of midline points, -1 to 1.

    Three points of the midline span the body's plane of symmetry, and their order says which way its normal points:
    forward times up is left. Which triple means which side is learned. No label is in it.
    """
    middle = sequence.middle(layout)
    across = sequence.across
    across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    a, b, c = (middle[:, triples[..., i]] for i in range(3))
    return np.einsum("fptx,fpx->fpt", _normals(a, b, c), across)


def _normals(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Of triangles, as long as the sine of the angle at a."""
    one, other = b - a, c - a
    lengths = np.linalg.norm(one, axis=-1, keepdims=True) * np.linalg.norm(other, axis=-1, keepdims=True)
    return np.cross(one, other) / np.maximum(lengths, 1e-9)


def _symmetry(sequence: Sequence, layout: Layout) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each pair the triples of midline points that tell its sides best: triples, mean, spread."""
    n_pairs, n_middle = len(layout.chain_of), len(layout.unpaired) + len(layout.middles)
    every = np.array(list(combinations(range(n_middle), 3)), dtype=np.int64).reshape(-1, 3)
    if not len(every):
        empty = np.zeros((n_pairs, 0))
        return np.zeros((n_pairs, 0, 3), dtype=np.int64), empty, empty
    some = np.unique(np.linspace(0, len(sequence.time_s) - 1, _FRAMES).astype(int))
    middle, across = sequence.middle(layout)[some], sequence.across[some]
    across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    normals = _normals(*(middle[:, every[:, i]] for i in range(3)))
    known = np.isfinite(normals[..., 0]).astype(float).T @ np.isfinite(across[..., 0]).astype(float)
    normals, across = np.nan_to_num(normals), np.nan_to_num(across)
    total = np.zeros_like(known)
    squares = np.zeros_like(known)
    for i in range(len(some)):
        cosines = normals[i] @ across[i].T
        total += cosines
        squares += cosines**2
    mean = total / np.maximum(known, 1.0)
    sd = np.sqrt(np.maximum(squares / np.maximum(known, 1.0) - mean**2, 0.0))
    sd = np.maximum(sd, _LEAST_SD)
    expected = np.zeros_like(mean)
    certain = np.full_like(mean, _NOT_SURE_OF)
    if len(layout.facing):
        # The facing triple comes in another order among the sorted ones, which may turn its normal over.
        k, sign = _place_of(layout.facing, every)
        expected[k], certain[k] = sign * _ALONG_BY_FACING * layout.trunk, _EXPECTED_FRAMES
    mean = (mean * known + expected * certain) / (known + certain)
    best = np.argsort(-np.abs(mean) / sd, axis=0, kind="stable")[:_TRIPLES].T
    pair = np.arange(n_pairs)[:, None]
    return every[best], mean[best, pair], sd[best, pair]


def _place_of(triple: np.ndarray, every: np.ndarray) -> tuple[int, float]:
    """Where a triple stands, in whatever order, and whether that order turns its normal over."""
    order = np.argsort(triple)
    k = int(np.flatnonzero((every == triple[order]).all(axis=1))[0])
    return k, float(np.linalg.det(np.eye(3)[order]))


def _links(sequence: Sequence, layout: Layout) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of each link: the bone's length on both sides and its spread, the cosine of its pairs and its spread."""
    a, b = sequence.points[:, layout.links[:, 0]], sequence.points[:, layout.links[:, 1]]
    lengths = np.linalg.norm(a - b, axis=-1)
    both_sides = np.concatenate([lengths[..., 0], lengths[..., 1]])
    length, length_sd = _middle_and_spread(both_sides, 0.0, 1e6)
    first, second = a[:, :, 1] - a[:, :, 0], b[:, :, 1] - b[:, :, 0]
    sizes = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    cosines = (first * second).sum(axis=-1) / np.maximum(sizes, 1e-12)
    likeness, likeness_sd = _middle_and_spread(cosines, 0.0, 1.0)
    seen = np.isfinite(cosines).sum(axis=0)
    likeness = (likeness * seen + _expected_likeness(layout) * _EXPECTED_FRAMES) / (seen + _EXPECTED_FRAMES)
    length_sd = np.maximum(length_sd, 0.02 * length + 1e-6) * (seen + _NOT_SURE_OF) / np.maximum(seen, 1)
    return length, length_sd, likeness, np.maximum(likeness_sd, _LEAST_SD)


def spreads(sequence: Sequence, layout: Layout) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each link, how far the bone's length varies as ordered and with one pair exchanged, and in how many frames."""
    a, b = sequence.points[:, layout.links[:, 0]], sequence.points[:, layout.links[:, 1]]
    out = []
    for other in (b, b[:, :, ::-1]):
        lengths = np.linalg.norm(a - other, axis=-1)
        out.append(_middle_and_spread(np.concatenate([lengths[..., 0], lengths[..., 1]]), 0.0, 1.0)[1] + 1e-4)
    return out[0], out[1], np.isfinite(lengths).all(axis=-1).sum(axis=0)


def _middle_and_spread(values: np.ndarray, middle: float, spread: float) -> tuple[np.ndarray, np.ndarray]:
    """Of each column: median, and standard deviation by the median deviation; as given where all is missing."""
    centre = _percentile(values, 50, middle)
    return centre, np.where(
        np.isfinite(values).any(axis=0), 1.4826 * _percentile(np.abs(values - centre), 50, spread), spread
    )


def _percentile(values: np.ndarray, percent: float, otherwise: float) -> np.ndarray:
    """Of the finite numbers of each column of (frame, column)."""
    ordered = np.sort(values, axis=0)
    known = np.isfinite(ordered).sum(axis=0)
    place = np.clip((percent / 100.0 * (known - 1)).astype(int), 0, None)
    if not len(ordered):
        return np.full(values.shape[1], otherwise)
    return np.where(known > 0, ordered[place, np.arange(values.shape[1])], otherwise)


_SURE = 2.5
"""Labels of smaller odds may be noise, which comes and goes faster than swaps."""
_AS_IF_SEEN = 30.0
"""Labels that what is expected of views counts for, where labels last or go together."""
_ALIKE = np.array(0.5)
_AS_IF_SEEN_APART = 6.0
"""Labels independent of each other that the expected share counts for."""


def _views(sequence: Sequence, layout: Layout, options: SideOptions) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each view: share of swapped labels, rate of forgetting, correlation within chains."""
    known = np.abs(sequence.odds) > _SURE
    swapped = (sequence.odds > 0.0) & known
    count, found = known.sum(axis=(0, 1)), swapped.sum(axis=(0, 1))
    rough = _share(found, count, _AS_IF_SEEN, options)
    off, variance = np.where(known, swapped - rough, 0.0), rough * (1.0 - rough)
    dt = float(np.median(np.diff(sequence.time_s))) if len(sequence.time_s) > 1 else 1.0 / 30.0
    expected_lasting = np.exp(-dt / (options.swap_duration_s * (1.0 - rough)))
    lasting = _correlation(off[1:], off[:-1], known[1:] & known[:-1], variance, expected_lasting)
    lasting = np.clip(lasting, 1e-6, 0.995)
    same = layout.chain_of[layout.links[:, 0]] == layout.chain_of[layout.links[:, 1]]
    a, b = layout.links[same].T
    alike = np.clip(_correlation(off[:, a], off[:, b], known[:, a] & known[:, b], variance, _ALIKE), 0.0, 0.98)
    # A swap that lasts is one observation, however many frames and joints it is seen in.
    size = np.bincount(layout.chain_of).mean() if len(layout.chain_of) else 1.0
    apart = (1.0 - lasting) / (1.0 + lasting) / (1.0 + (size - 1.0) * alike)
    return _share(found * apart, count * apart, _AS_IF_SEEN_APART, options), -np.log(lasting) / dt, alike


def _share(found: np.ndarray, count: np.ndarray, as_if_seen: float, options: SideOptions) -> np.ndarray:
    """Of swapped labels; a view that is wrong more often than not may be so for good, and tells nothing."""
    return np.clip((found + as_if_seen * options.swap_share) / (count + as_if_seen), 0.01, 0.49)


def _correlation(
    one: np.ndarray, other: np.ndarray, both: np.ndarray, variance: np.ndarray, prior: np.ndarray
) -> np.ndarray:
    """Shape (view,), of deviations (frame, pair, view) over those known of both.

    What is seen in one view stands beside what is seen in all, and that beside ``prior``: a view that hardly ever swaps
    shows little but noise.
    """
    products = (one * other).sum(axis=(0, 1))
    weight = both.sum(axis=(0, 1)) * variance
    prior_weight = 0.15 * _AS_IF_SEEN
    pooled = (products.sum() + prior_weight * prior) / (weight.sum() + prior_weight)
    return (products + _AS_IF_SEEN * pooled) / (weight + _AS_IF_SEEN)
