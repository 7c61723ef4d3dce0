"""What the statuses of a layer state about its points, as the conventions define it."""

from collections.abc import Mapping

import numpy as np

from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus, is_used
from posefuse.model.stored_points import StoredPoints

_VIEWS = {
    PointStatus.OK: (3, None),
    PointStatus.TWO_VIEWS: (2, 2),
    PointStatus.WEAK_GEOMETRY: (2, None),
    PointStatus.AMBIGUOUS: (2, None),
    PointStatus.SINGLE_VIEW: (1, 1),
    PointStatus.HELD: (1, 1),
    PointStatus.FILLED: (0, 0),
}
"""Minimum and maximum number of used views by status."""


def assert_statuses_hold(layer: Layer, where: str = "") -> None:
    """Check that a status implies a point exactly if there are coordinates, a covariance and the stated views."""
    assert violations(layer) == {}, where


def assert_all_statuses_hold(result: Reconstruction) -> None:
    """Check the statuses of every layer of a result."""
    for name, layer in result.layers.items():
        assert_statuses_hold(layer, name)


def violations(layer: Layer | StoredPoints) -> Mapping[str, int]:
    """Return the number of points that contradict their status, by what contradicts it.

    A file may lack the covariance, or hold the number of views instead of their statuses.
    """
    assert layer.status is not None
    assert layer.source is not None
    status, source = np.asarray(layer.status[:]), np.asarray(layer.source[:])
    has_point = status < PointStatus.NOT_SEEN
    found = {
        "unknown status": ~np.isin(status, list(PointStatus)),
        "unknown source": ~np.isin(source, list(Source)),
        "source without point": (source != Source.NONE) != has_point,
        "filled by status or source only": (source == Source.FILLED) != (status == PointStatus.FILLED),
    }
    for name in ("points_m", "covariance_m2"):
        if getattr(layer, name) is None:
            continue
        finite = np.isfinite(np.asarray(getattr(layer, name)[:]))
        found[f"{name} missing"] = has_point & ~finite.all(axis=-1)
        found[f"{name} of a missing point"] = ~has_point & finite.any(axis=-1)
    if layer.view_status is None:
        n_views = np.asarray(layer.n_views)
    else:
        views = np.asarray(layer.view_status[:])
        n_views = is_used(views).sum(axis=-1)
        found["unknown view status"] = ~np.isin(views, list(ViewStatus)).all(axis=-1)
    found["used views of a missing point"] = ~has_point & (n_views > 0)
    for code, (least, most) in _VIEWS.items():
        here = status == code
        found[f"{code.label} with fewer than {least} views"] = here & (n_views < least)
        if most is not None:
            found[f"{code.label} with more than {most} views"] = here & (n_views > most)
    return {what: int(where.sum()) for what, where in found.items() if where.any()}
