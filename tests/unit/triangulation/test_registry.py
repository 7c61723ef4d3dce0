"""All triangulation methods on the same data with outliers."""

import numpy as np
import pytest

from posefuse.model.options.triangulation import (
    FREEMOCAP_METHODS,
    METHODS,
    TriangulationOptions,
)
from posefuse.model.status import ViewStatus
from posefuse.triangulation import registry

from .conftest import errors_mm, triangulate_walk


def test_table_agrees_with_the_options():
    assert list(registry.METHODS) == list(METHODS)
    for name, method in registry.METHODS.items():
        assert method.name == name
        assert method.sentence == METHODS[name]
        if method.options is not None:
            assert isinstance(getattr(TriangulationOptions(), name), method.options)


@pytest.mark.parametrize("method", METHODS)
def test_methods_agree_without_outliers(method, clean):
    layer = triangulate_walk(clean, method)
    reference = np.median(errors_mm(clean, triangulate_walk(clean, "simple")))
    worst = {"percentile_filter": 1.4, "midpoint": 1.1, "ransac": 1.03, "irls": 1.05}.get(method, 1.02)
    assert np.nanmedian(errors_mm(clean, layer)) < worst * reference
    assert layer.has_point.mean() > (0.97 if method == "percentile_filter" else 0.999)


@pytest.mark.parametrize(
    ("method", "rules"),
    [*((method, "documentation") for method in METHODS), *((method, "program") for method in FREEMOCAP_METHODS)],
)
def test_points_statuses_and_views_are_consistent(method, rules, ugly):
    layer = triangulate_walk(ugly, method, freemocap_rules=rules)
    np.testing.assert_array_equal(np.isfinite(layer.points_m).all(axis=-1), layer.has_point)
    np.testing.assert_array_equal(np.isfinite(layer.covariance_m2).all(axis=-1), layer.has_point)
    used = layer.view_status == ViewStatus.USED
    np.testing.assert_array_equal(used.any(axis=-1), layer.has_point)
    mean = np.where(used, layer.view_error_px, 0).sum(axis=-1) / np.maximum(used.sum(axis=-1), 1)
    np.testing.assert_allclose(layer.reprojection_error_px[layer.has_point], mean[layer.has_point], rtol=1e-4)


@pytest.mark.parametrize("method", METHODS)
def test_rules_of_freemocap_change_its_methods_only(method, ugly):
    first = ugly.first(20)
    layers = [triangulate_walk(first, method, freemocap_rules=rules) for rules in ("documentation", "program")]
    assert (layers[0] == layers[1]) == (method not in FREEMOCAP_METHODS)


@pytest.mark.parametrize(
    ("method", "far_share"),
    [("consensus", 0.0005), ("ransac", 0.002), ("irls", 0.02), ("weighted_subsets", 0.04), ("percentile_filter", 0.04)],
)
def test_robust_methods_resist_outliers(method, far_share, ugly):
    judged = ugly.inlier.sum(axis=1) >= 3
    far = errors_mm(ugly, triangulate_walk(ugly, method))[judged] > 50
    assert far.mean() <= far_share
    assert (errors_mm(ugly, triangulate_walk(ugly, "simple"))[judged] > 50).mean() > 0.15
