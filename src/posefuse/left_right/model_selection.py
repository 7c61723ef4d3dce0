"""Revert swaps that do not explain the observations better than the labels.

Many frames seem to be strong evidence, but errors persist, and a slightly misplaced camera errs alike all the time. If
two views see a limb, and its points are close together relative to the noise, the wrong pairing can fit slightly better
for seconds. A segment in which only some views are swapped must therefore fit significantly better.
"""

import numpy as np

from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, ViewStatus

_VALID = (ViewStatus.USED, ViewStatus.OUTLIER, ViewStatus.NOT_USED)
_FAR_SIGMA = 5.0
_REQUIRED_GAIN = 2.0
"""Required gain in squared standard deviations, on average, per pair and view that differs from the other views."""


def revert_unsupported_swaps(
    swapped: np.ndarray,
    as_labeled: Layer,
    exchanged: Layer,
    noise: NoiseModel,
    pairs: np.ndarray,
    chain_of: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the swaps that remain once unsupported segments are reverted.

    In a reverted segment, all views of the limb are set to the state of their majority.

    Args:
        swapped: shape (frame, person, pair, view), bool.
        as_labeled: points with the original labels.
        exchanged: points with exchanged labels.
        noise: error model of the detections.
        pairs: shape (pair, 2): keypoint indices, left and right.
        chain_of: shape (pair,): limb of each pair.

    Returns:
        The swaps; and shape (frame, person, pair), bool: where they were reverted.
    """
    seen = _seen(as_labeled, pairs)
    minority = np.minimum((swapped & seen).sum(axis=-1), (~swapped & seen).sum(axis=-1))
    gain = bounded_cost(as_labeled, noise, pairs) - bounded_cost(exchanged, noise, pairs) - _REQUIRED_GAIN * minority
    votes = np.where(seen, np.where(swapped, 1, -1), 0)
    reverted = np.zeros(swapped.shape[:3], dtype=bool)
    majority = np.zeros(swapped.shape[:3], dtype=bool)
    for chain in np.unique(chain_of):
        members = np.flatnonzero(chain_of == chain)
        views = np.sign(votes[:, :, members].sum(axis=2))
        majority[:, :, members] = views.sum(axis=-1, keepdims=True) > 0
        for person in range(swapped.shape[1]):
            mixed = (minority[:, person, members] > 0).any(axis=-1)
            total = gain[:, person, members].sum(axis=-1)
            for start, stop in _runs(mixed):
                if total[start:stop].sum() <= 0.0:
                    reverted[start:stop, person, members] = True
    return np.where(reverted[..., None], majority[..., None], swapped), reverted


def _seen(layer: Layer, pairs: np.ndarray) -> np.ndarray:
    """Return whether a view has a usable observation of either keypoint, shape (frame, person, pair, view)."""
    return np.asarray(np.isin(np.asarray(layer.view_status)[:, :, pairs], _VALID).any(axis=3))


def bounded_cost(layer: Layer, noise: NoiseModel, pairs: np.ndarray) -> np.ndarray:
    """Return the sum of the bounded squared residuals of both points, shape (frame, person, pair).

    Residuals are in standard deviations. Observations of a missing point count at the bound.
    """
    status = np.asarray(layer.view_status)[:, :, pairs]
    errors = np.asarray(layer.view_error_px)[:, :, pairs] / noise.scale_px
    missing = np.asarray(layer.status)[:, :, pairs] >= PointStatus.NOT_SEEN
    squared = np.where(missing[..., None] | np.isnan(errors), _FAR_SIGMA, np.minimum(errors, _FAR_SIGMA)) ** 2
    counts = np.isin(status, _VALID)
    return np.where(counts, squared, 0.0).sum(axis=(3, 4))


def _runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Return the start and stop of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]
