"""Estimate motion, bones, symmetry and view statistics for the assignment of left and right from the recording itself.

No body measurements are needed. Each number is a robust estimate over the frames in the current order; as long as most
of that order is correct, so is the estimate, and the next assignment improves.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from posefuse.left_right.layout import Layout
from posefuse.left_right.person_sequence import PersonSequence
from posefuse.model.options.left_right import SideOptions

_MAX_FRAMES = 300
_MAX_TRIPLES = 3
_SHRINKAGE_FRAMES = 30.0
"""Shrinkage of estimates from n frames: means are multiplied by n / (n + 30), spreads by (n + 30) / n."""
_MIN_SD = 0.2
_TRUNK_COSINE, _TRUNK_COSINE_SD = 0.6, 0.5
_FACING_COSINE, _FACING_COSINE_SD = 0.45, 0.35
_EXPECTED_FRAMES = 60.0
"""Number of frames that the generic body counts for."""


@dataclass(frozen=True, eq=False)
class SideModel:
    """Hold the estimates for one person and the views.

    Attributes:
        turn_speed: shape (pair,): rate of change of the vector between the two points, m/s per axis.
        speed: shape (pair,): speed of a point, m/s per axis.
        length, length_sd: shape (link,): length of the bone between two pairs, m.
        direction_cosine, direction_cosine_sd: shape (link,): cosine between the vectors of two pairs.
        triples: shape (pair, T, 3), int64: points of the midline; the pair is aligned with the normal of their plane.
        symmetry_cosine, symmetry_cosine_sd: shape (pair, T): cosine between the pair's vector and that normal.
        swap_share: shape (view,): share of the time in which labels are swapped.
        forgetting_rate: shape (view,): rate at which a swap state decays, 1/s.
        chain_correlation: shape (view,): correlation of the labels within a chain.
    """

    turn_speed: np.ndarray
    speed: np.ndarray
    length: np.ndarray
    length_sd: np.ndarray
    direction_cosine: np.ndarray
    direction_cosine_sd: np.ndarray
    triples: np.ndarray
    symmetry_cosine: np.ndarray
    symmetry_cosine_sd: np.ndarray
    swap_share: np.ndarray
    forgetting_rate: np.ndarray
    chain_correlation: np.ndarray


def initial_model(sequence: PersonSequence, layout: Layout, options: SideOptions) -> SideModel:
    """Return the model before any assignment: measured motion, a generic body, and the options' view statistics."""
    links, views = len(layout.links), sequence.odds.shape[2]
    turn_speed, speed = speeds(sequence)
    triples, symmetry_cosine, symmetry_cosine_sd = _expected_symmetry(layout)
    return SideModel(
        turn_speed=turn_speed,
        speed=speed,
        length=np.zeros(links),
        length_sd=np.full(links, 1e6),
        direction_cosine=_expected_direction_cosine(layout),
        direction_cosine_sd=np.full(links, _TRUNK_COSINE_SD),
        triples=triples,
        symmetry_cosine=symmetry_cosine,
        symmetry_cosine_sd=symmetry_cosine_sd,
        swap_share=np.full(views, options.swap_share),
        forgetting_rate=np.full(views, 1.0 / (options.swap_duration_s * (1.0 - options.swap_share))),
        chain_correlation=np.full(views, 0.5),
    )


def with_generic_body(layout: Layout, model: SideModel) -> SideModel:
    """Return the model with its body replaced by a generic one."""
    links = len(layout.links)
    triples, symmetry_cosine, symmetry_cosine_sd = _expected_symmetry(layout)
    return replace(
        model,
        length=np.zeros(links),
        length_sd=np.full(links, 1e6),
        direction_cosine=_expected_direction_cosine(layout),
        direction_cosine_sd=np.full(links, _TRUNK_COSINE_SD),
        triples=triples,
        symmetry_cosine=symmetry_cosine,
        symmetry_cosine_sd=symmetry_cosine_sd,
    )


def _expected_direction_cosine(layout: Layout) -> np.ndarray:
    """Return the expected cosine of each link, shape (link,).

    Hips and shoulders are expected to be parallel; other pairs have the value 0, which carries no information.
    """
    return np.where(layout.trunk[layout.links].all(axis=1), _TRUNK_COSINE, 0.0)


def _expected_symmetry(layout: Layout) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for each pair the triple of shoulders, hips and nose, which determines the sides of the trunk."""
    n_pairs, n_triples = len(layout.chain_of), int(len(layout.facing) > 0)
    triples = np.tile(layout.facing.reshape(n_triples, 3), (n_pairs, 1, 1))
    symmetry_cosine = np.tile(np.where(layout.trunk, _FACING_COSINE, 0.0)[:, None], (1, n_triples))
    return triples, symmetry_cosine, np.full((n_pairs, n_triples), _FACING_COSINE_SD)


def estimate_model(sequence: PersonSequence, layout: Layout, options: SideOptions) -> SideModel:
    """Estimate the model from frames in the decided order."""
    share, rate, chain_correlation = _views(sequence, layout, options)
    turn_speed, speed = speeds(sequence)
    length, length_sd, direction_cosine, direction_cosine_sd = _links(sequence, layout)
    triples, symmetry_cosine, symmetry_cosine_sd = _symmetry(sequence, layout)
    return SideModel(
        turn_speed,
        speed,
        length,
        length_sd,
        direction_cosine,
        direction_cosine_sd,
        triples,
        symmetry_cosine,
        symmetry_cosine_sd,
        share,
        rate,
        chain_correlation,
    )


def speeds(sequence: PersonSequence) -> tuple[np.ndarray, np.ndarray]:
    """Return speeds of the pair vectors and of the points, shape (pair,) each, independent of the order."""
    dt = np.diff(sequence.time_s)[:, None]
    across, middle = sequence.across, sequence.points.mean(axis=2)
    noise = sequence.covariance[..., [0, 3, 5]].sum(axis=(-1, -2))
    noise = noise[1:] + noise[:-1]
    vector_change = np.minimum(
        np.square(across[1:] - across[:-1]).sum(axis=-1), np.square(across[1:] + across[:-1]).sum(axis=-1)
    )
    point_change = np.square(np.diff(middle, axis=0)).sum(axis=-1)
    size = _percentile(np.linalg.norm(across, axis=-1), 50, 0.1)
    turn = _percentile(np.sqrt(np.maximum(vector_change - noise, 0.0) / 3.0) / dt, 80, 1.0)
    move = _percentile(np.sqrt(np.maximum(point_change - 0.25 * noise, 0.0) / 3.0) / dt, 80, 1.0)
    turn = np.maximum(turn, 0.5 * size)
    return turn, np.maximum(np.hypot(move, 0.5 * turn), 0.5 * size)


def symmetry_cosines(sequence: PersonSequence, layout: Layout, triples: np.ndarray) -> np.ndarray:
    """Return cosines between pair vectors and the normals of triples of midline points, shape (frame, pair, T).

    Three points of the midline span the body's plane of symmetry, and their order defines the direction of the normal:
    forward times up is left. Which triple corresponds to which side is estimated. Labels are not used.
    """
    middle = sequence.middle(layout)
    across = sequence.across
    across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    return np.einsum("fptx,fpx->fpt", _normals(middle, triples), across)


def _normals(middle: np.ndarray, triples: np.ndarray) -> np.ndarray:
    """Return normals of triangles whose length is the sine of the angle at the first point, shape (frame, ..., 3).

    Args:
        middle: shape (frame, point, 3).
        triples: shape (..., 3): points of the triangles.
    """
    # Coordinate by coordinate: NumPy's cross product and norms take three times as long.
    a, b, c = ([np.take(middle[..., axis], triples[..., i], axis=1) for axis in range(3)] for i in range(3))
    x, y, z = (second - first for first, second in zip(a, b, strict=True))
    u, v, w = (third - first for first, third in zip(a, c, strict=True))
    lengths = np.maximum(np.sqrt(x * x + y * y + z * z) * np.sqrt(u * u + v * v + w * w), 1e-9)
    return np.stack([(y * w - z * v) / lengths, (z * u - x * w) / lengths, (x * v - y * u) / lengths], axis=-1)


def _symmetry(sequence: PersonSequence, layout: Layout) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for each pair the triples of midline points that best separate its sides: triples, means, spreads."""
    n_pairs, n_middle = len(layout.chain_of), len(layout.unpaired) + len(layout.middles)
    all_triples = np.array(list(combinations(range(n_middle), 3)), dtype=np.int64).reshape(-1, 3)
    if not len(all_triples):
        empty = np.zeros((n_pairs, 0))
        return np.zeros((n_pairs, 0, 3), dtype=np.int64), empty, empty
    sampled = np.unique(np.linspace(0, len(sequence.time_s) - 1, _MAX_FRAMES).astype(int))
    middle, across = sequence.middle(layout)[sampled], sequence.across[sampled]
    across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    normals = _normals(middle, all_triples)
    known = np.isfinite(normals[..., 0]).astype(float).T @ np.isfinite(across[..., 0]).astype(float)
    normals, across = np.nan_to_num(normals), np.nan_to_num(across)
    total = np.zeros_like(known)
    squares = np.zeros_like(known)
    for i in range(len(sampled)):
        cosines = normals[i] @ across[i].T
        total += cosines
        squares += cosines**2
    mean = total / np.maximum(known, 1.0)
    sd = np.sqrt(np.maximum(squares / np.maximum(known, 1.0) - mean**2, 0.0))
    sd = np.maximum(sd, _MIN_SD)
    expected = np.zeros_like(mean)
    prior_weight = np.full_like(mean, _SHRINKAGE_FRAMES)
    if len(layout.facing):
        # The sorted facing triple may have the opposite normal.
        k, sign = _find_triple(layout.facing, all_triples)
        expected[k], prior_weight[k] = sign * _FACING_COSINE * layout.trunk, _EXPECTED_FRAMES
    mean = (mean * known + expected * prior_weight) / (known + prior_weight)
    best = np.argsort(-np.abs(mean) / sd, axis=0, kind="stable")[:_MAX_TRIPLES].T
    pair = np.arange(n_pairs)[:, None]
    return all_triples[best], mean[best, pair], sd[best, pair]


def _find_triple(triple: np.ndarray, all_triples: np.ndarray) -> tuple[int, float]:
    """Return the index of a triple in any order, and the sign by which that order turns its normal."""
    order = np.argsort(triple)
    k = int(np.flatnonzero((all_triples == triple[order]).all(axis=1))[0])
    return k, float(np.linalg.det(np.eye(3)[order]))


def _links(sequence: PersonSequence, layout: Layout) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return for each link the bone length and the cosine of its pairs, each with its spread."""
    a, b = sequence.points[:, layout.links[:, 0]], sequence.points[:, layout.links[:, 1]]
    lengths = np.linalg.norm(a - b, axis=-1)
    both_sides = np.concatenate([lengths[..., 0], lengths[..., 1]])
    length, length_sd = _median_and_spread(both_sides, 0.0, 1e6)
    first, second = a[:, :, 1] - a[:, :, 0], b[:, :, 1] - b[:, :, 0]
    sizes = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    cosines = (first * second).sum(axis=-1) / np.maximum(sizes, 1e-12)
    direction_cosine, direction_cosine_sd = _median_and_spread(cosines, 0.0, 1.0)
    seen = np.isfinite(cosines).sum(axis=0)
    direction_cosine = (direction_cosine * seen + _expected_direction_cosine(layout) * _EXPECTED_FRAMES) / (
        seen + _EXPECTED_FRAMES
    )
    length_sd = np.maximum(length_sd, 0.02 * length + 1e-6) * (seen + _SHRINKAGE_FRAMES) / np.maximum(seen, 1)
    return length, length_sd, direction_cosine, np.maximum(direction_cosine_sd, _MIN_SD)


def bone_spreads(sequence: PersonSequence, layout: Layout) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the spread of each link's bone length, as ordered and with one pair exchanged.

    The third array is the number of frames.
    """
    a, b = sequence.points[:, layout.links[:, 0]], sequence.points[:, layout.links[:, 1]]
    out = []
    for second in (b, b[:, :, ::-1]):
        lengths = np.linalg.norm(a - second, axis=-1)
        out.append(_median_and_spread(np.concatenate([lengths[..., 0], lengths[..., 1]]), 0.0, 1.0)[1] + 1e-4)
    return out[0], out[1], np.isfinite(lengths).all(axis=-1).sum(axis=0)


def _median_and_spread(values: np.ndarray, middle: float, spread: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the median of each column, and the standard deviation estimated from the median absolute deviation.

    Columns without finite values have the given defaults.
    """
    center = _percentile(values, 50, middle)
    return center, np.where(
        np.isfinite(values).any(axis=0), 1.4826 * _percentile(np.abs(values - center), 50, spread), spread
    )


def _percentile(values: np.ndarray, percent: float, default: float) -> np.ndarray:
    """Return a percentile of the finite values of each column of (frame, column)."""
    ordered = np.sort(values, axis=0)
    known = np.isfinite(ordered).sum(axis=0)
    place = np.clip((percent / 100.0 * (known - 1)).astype(int), 0, None)
    if not len(ordered):
        return np.full(values.shape[1], default)
    return np.where(known > 0, ordered[place, np.arange(values.shape[1])], default)


_MIN_LOG_ODDS = 2.5
"""Labels with smaller log odds can be noise, which varies faster than swaps."""
_PRIOR_LABELS = 30.0
"""Number of labels that the expected statistics of a view count for, where labels persist or agree."""
_PRIOR_CORRELATION = np.array(0.5)
_PRIOR_INDEPENDENT_LABELS = 6.0
"""Number of independent labels that the expected share counts for."""


def _views(sequence: PersonSequence, layout: Layout, options: SideOptions) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for each view the share of swapped labels, the forgetting rate, and the correlation within chains."""
    known = np.abs(sequence.odds) > _MIN_LOG_ODDS
    swapped = (sequence.odds > 0.0) & known
    count, n_swapped = known.sum(axis=(0, 1)), swapped.sum(axis=(0, 1))
    rough = _share(n_swapped, count, _PRIOR_LABELS, options)
    deviation, variance = np.where(known, swapped - rough, 0.0), rough * (1.0 - rough)
    dt = float(np.median(np.diff(sequence.time_s))) if len(sequence.time_s) > 1 else 1.0 / 30.0
    expected_persistence = np.exp(-dt / (options.swap_duration_s * (1.0 - rough)))
    persistence = _correlation(deviation[1:], deviation[:-1], known[1:] & known[:-1], variance, expected_persistence)
    persistence = np.clip(persistence, 1e-6, 0.995)
    same = layout.chain_of[layout.links[:, 0]] == layout.chain_of[layout.links[:, 1]]
    a, b = layout.links[same].T
    chain_correlation = np.clip(
        _correlation(deviation[:, a], deviation[:, b], known[:, a] & known[:, b], variance, _PRIOR_CORRELATION),
        0.0,
        0.98,
    )
    # A persistent swap is one observation, however many frames and joints show it.
    size = np.bincount(layout.chain_of).mean() if len(layout.chain_of) else 1.0
    independence = (1.0 - persistence) / (1.0 + persistence) / (1.0 + (size - 1.0) * chain_correlation)
    return (
        _share(n_swapped * independence, count * independence, _PRIOR_INDEPENDENT_LABELS, options),
        -np.log(persistence) / dt,
        chain_correlation,
    )


def _share(n_swapped: np.ndarray, count: np.ndarray, prior_labels: float, options: SideOptions) -> np.ndarray:
    """Return the share of swapped labels, below 0.5: a view that is mostly wrong carries no information."""
    return np.clip((n_swapped + prior_labels * options.swap_share) / (count + prior_labels), 0.01, 0.49)


def _correlation(
    first: np.ndarray, second: np.ndarray, both: np.ndarray, variance: np.ndarray, prior: np.ndarray
) -> np.ndarray:
    """Return the correlation of deviations (frame, pair, view) where both are known, shape (view,).

    Each view's estimate is shrunk toward that of all views, and this toward ``prior``: a view that rarely swaps shows
    little but noise.
    """
    products = (first * second).sum(axis=(0, 1))
    weight = both.sum(axis=(0, 1)) * variance
    prior_weight = 0.15 * _PRIOR_LABELS
    pooled = (products.sum() + prior_weight * prior) / (weight.sum() + prior_weight)
    return (products + _PRIOR_LABELS * pooled) / (weight + _PRIOR_LABELS)
