"""Whether exchanging labels explains the observations better than believing them.

Many frames are much evidence, but errors last, and a camera a little out of place errs alike all the time: with two
views that see a limb, and points not far apart for the noise, the wrong pairing may look a little better for seconds.
So a stretch in which some views are said to be swapped and others not must earn it.
"""

import numpy as np

from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, ViewStatus

_VALID = (ViewStatus.USED, ViewStatus.OUTLIER, ViewStatus.NOT_USED)
_FAR_SIGMA = 5.0
_WORTH = 2.0
"""By how many squared sigmas a pair seen by a view has to fit better, on average, for the view to be out of step."""


def settled(
    swapped: np.ndarray,
    believed: Layer,
    exchanged: Layer,
    noise: NoiseModel,
    pairs: np.ndarray,
    chain_of: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """What is left of the swaps once stretches that are not worth it are taken back.

    Where they are, all views of the limb are taken alike, by what most of them were.

    Args:
        swapped: shape (frame, person, pair, view), bool.
        believed: points by the labels as they are.
        exchanged: points by the labels exchanged.
        noise: of the detections.
        pairs: shape (pair, 2): keypoints, left and right.
        chain_of: shape (pair,): the limb of each pair.

    Returns:
        The swaps; and shape (frame, person, pair), bool: where they were taken back.
    """
    seen = _seen(believed, pairs)
    out_of_step = np.minimum((swapped & seen).sum(axis=-1), (~swapped & seen).sum(axis=-1))
    gain = cost(believed, noise, pairs) - cost(exchanged, noise, pairs) - _WORTH * out_of_step
    said = np.where(seen, np.where(swapped, 1, -1), 0)
    back = np.zeros(swapped.shape[:3], dtype=bool)
    alike = np.zeros(swapped.shape[:3], dtype=bool)
    for chain in np.unique(chain_of):
        members = np.flatnonzero(chain_of == chain)
        views = np.sign(said[:, :, members].sum(axis=2))
        alike[:, :, members] = views.sum(axis=-1, keepdims=True) > 0
        for person in range(swapped.shape[1]):
            mixed = (out_of_step[:, person, members] > 0).any(axis=-1)
            total = gain[:, person, members].sum(axis=-1)
            for start, stop in _runs(mixed):
                if total[start:stop].sum() <= 0.0:
                    back[start:stop, person, members] = True
    return np.where(back[..., None], alike[..., None], swapped), back


def _seen(layer: Layer, pairs: np.ndarray) -> np.ndarray:
    """Shape (frame, person, pair, view): whether a view has an observation of either keypoint that may be used."""
    return np.asarray(np.isin(np.asarray(layer.view_status)[:, :, pairs], _VALID).any(axis=3))


def cost(layer: Layer, noise: NoiseModel, pairs: np.ndarray) -> np.ndarray:
    """Shape (frame, person, pair): the squared residuals of both points, each bounded, in squared sigmas.

    Observations of a point that is missing cost as much as they can.
    """
    status = np.asarray(layer.view_status)[:, :, pairs]
    errors = np.asarray(layer.view_error_px)[:, :, pairs] / noise.scale_px
    missing = np.asarray(layer.status)[:, :, pairs] >= PointStatus.NOT_SEEN
    squared = np.where(missing[..., None] | np.isnan(errors), _FAR_SIGMA, np.minimum(errors, _FAR_SIGMA)) ** 2
    counts = np.isin(status, _VALID)
    return np.where(counts, squared, 0.0).sum(axis=(3, 4))


def _runs(there: np.ndarray) -> list[tuple[int, int]]:
    """Where stretches of true begin and end."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(np.int8)))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]
