"""Statuses of layers, compared with those of a point-by-point check."""

import numpy as np

from posefuse.model.layer_statuses import with_true_statuses
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, Source, ViewStatus

FRAMES, KEYPOINTS, VIEWS = 40, 3, 4


def layer(rng: np.random.Generator, statuses: list[PointStatus]) -> Layer:
    """Return a layer in which statuses and points do not match."""
    shape = FRAMES, 1, KEYPOINTS
    points, covariance = rng.normal(size=(*shape, 3)), rng.normal(size=(*shape, 6))
    points[rng.random(shape) < 0.2, 1] = np.nan
    covariance[rng.random(shape) < 0.2, 5] = np.inf
    return Layer(
        points,
        covariance,
        rng.choice(np.array(statuses, dtype=np.int8), shape),
        np.full(shape, Source.MEASURED, dtype=np.int8),
        rng.normal(size=shape),
        rng.choice(np.array(ViewStatus, dtype=np.int8), (*shape, VIEWS)),
        rng.normal(size=(*shape, VIEWS)).astype(np.float32),
    )


def test_a_status_implies_a_point():
    before = layer(np.random.default_rng(0), list(PointStatus))
    after = with_true_statuses(before)
    least = {PointStatus.OK: 3, PointStatus.TWO_VIEWS: 2, PointStatus.WEAK_GEOMETRY: 2, PointStatus.AMBIGUOUS: 2}
    by_number = [PointStatus.FILLED, PointStatus.HELD, PointStatus.TWO_VIEWS, PointStatus.OK]
    for index in np.ndindex(before.status.shape):
        used = np.isin(before.view_status[index], (ViewStatus.USED, ViewStatus.USED_SWAPPED))
        expected = before.status[index]
        finite = np.isfinite(before.points_m[index]).all() and np.isfinite(before.covariance_m2[index]).all()
        if expected < PointStatus.NOT_SEEN and not finite:
            expected = PointStatus.UNCERTAIN
        if used.sum() < least.get(PointStatus(expected), 0):
            expected = by_number[min(used.sum(), 3)]
        assert after.status[index] == expected
        missing = expected >= PointStatus.NOT_SEEN
        kept = {PointStatus.FILLED: Source.FILLED}.get(PointStatus(expected), Source.MEASURED)
        assert after.source[index] == (Source.NONE if missing else kept)
        for name in ("points_m", "covariance_m2", "reprojection_error_px", "view_error_px"):
            values = getattr(after, name)[index]
            np.testing.assert_array_equal(values, np.nan if missing else getattr(before, name)[index])
        judged = np.where(used & missing, ViewStatus.NOT_USED, before.view_status[index])
        np.testing.assert_array_equal(after.view_status[index], judged)


def test_arrays_that_are_true_are_not_copied():
    before = with_true_statuses(layer(np.random.default_rng(1), list(PointStatus)))
    after = with_true_statuses(before)
    assert after == before
    assert np.shares_memory(after.points_m, before.points_m)
    assert np.shares_memory(after.covariance_m2, before.covariance_m2)
