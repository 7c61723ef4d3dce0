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
    finite = np.isfinite(layer.points_m).all(axis=-1) & np.isfinite(layer.covariance_m2).all(axis=-1)
    true = np.where((status < PointStatus.NOT_SEEN) & ~finite, PointStatus.UNCERTAIN, status)
    n_views = is_used(layer.view_status).sum(axis=-1)
    for code, least in _MIN_VIEWS.items():
        true = np.where((true == code) & (n_views < least), status_of_views(n_views), true)
    missing = true >= PointStatus.NOT_SEEN
    source = np.where(missing, Source.NONE, layer.source)
    views = np.where(missing[..., None] & is_used(layer.view_status), ViewStatus.NOT_USED, layer.view_status)
    without_point = missing[..., None]
    return replace(
        layer,
        points_m=np.where(without_point, np.nan, layer.points_m),
        covariance_m2=np.where(without_point, np.nan, layer.covariance_m2),
        status=true.astype(np.int8),
        source=np.where(true == PointStatus.FILLED, Source.FILLED, source).astype(np.int8),
        reprojection_error_px=np.where(missing, np.nan, layer.reprojection_error_px),
        view_status=views.astype(np.int8),
        view_error_px=np.where(without_point, np.float32(np.nan), layer.view_error_px),
    )
