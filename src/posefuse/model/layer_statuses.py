"""Make every status of a layer true: the one place that all computed layers pass."""

from dataclasses import replace

import numpy as np

from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, Source, ViewStatus, is_used, status_of_views

_MIN_VIEWS = {PointStatus.OK: 3, PointStatus.TWO_VIEWS: 2, PointStatus.WEAK_GEOMETRY: 2, PointStatus.AMBIGUOUS: 2}
"""Minimum number of used views by status."""


def with_true_statuses(layer: Layer) -> Layer:
    """Return a layer in memory in which a status implies a point exactly if there is one, from the stated views.

    A solver's status stays, unless the point has no finite coordinates or no finite covariance, which makes it
    uncertain, or fewer views than the status states, which is then derived from their number.
    """
    status = np.asarray(layer.status)
    finite = _all_last(np.isfinite(layer.points_m)) & _all_last(np.isfinite(layer.covariance_m2))
    true = np.where((status < PointStatus.NOT_SEEN) & ~finite, np.int8(PointStatus.UNCERTAIN), status)
    used = is_used(layer.view_status)
    # A byte per view would overflow beyond 127 views.
    n_views = sum((used[..., view] for view in range(used.shape[-1])), np.zeros(status.shape, dtype=np.int16))
    for code, least in _MIN_VIEWS.items():
        wrong = (true == code) & (n_views < least)
        true[wrong] = status_of_views(n_views[wrong])
    missing = true >= PointStatus.NOT_SEEN
    source = np.where(missing, np.int8(Source.NONE), layer.source)
    return replace(
        layer,
        points_m=_without(layer.points_m, missing, np.nan),
        covariance_m2=_without(layer.covariance_m2, missing, np.nan),
        status=true.astype(np.int8),
        source=np.where(true == PointStatus.FILLED, np.int8(Source.FILLED), source).astype(np.int8),
        reprojection_error_px=_without(layer.reprojection_error_px, missing, np.nan),
        view_status=_without(layer.view_status, missing[..., None] & used, ViewStatus.NOT_USED).astype(np.int8),
        view_error_px=_without(layer.view_error_px, missing, np.nan),
    )


def _all_last(mask: np.ndarray) -> np.ndarray:
    """Return whether all elements along the short last axis are true."""
    out = mask[..., 0]
    for n in range(1, mask.shape[-1]):
        out = out & mask[..., n]
    return out


def _without(values: np.ndarray, missing: np.ndarray, value: float) -> np.ndarray:
    """Return an array with a value where ``missing``, which has the first axes; the array itself where it has it."""
    array = np.asarray(values)
    lost = array[missing]
    if (np.isnan(lost) if np.isnan(value) else lost == value).all():
        return array
    array = array.copy()
    array[missing] = value
    return array
