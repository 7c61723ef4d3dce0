"""The method ransac."""

import pytest
from benchmarks.walking import walk

from posefuse.errors import OptionsError
from posefuse.model.options.triangulation import RansacOptions, WeightedSubsetsOptions
from posefuse.model.status import PointStatus

from .conftest import errors_mm, triangulate_walk


def test_threshold_in_meters():
    data = walk(60, 6, outlier_share=0.1)
    layer = triangulate_walk(data, "ransac", ransac=RansacOptions(threshold_m=0.06))
    judged = data.inlier.sum(axis=1) >= 3
    assert (errors_mm(data, layer)[judged] > 60).mean() < 0.01


@pytest.mark.parametrize(
    ("record", "given"),
    [
        (RansacOptions, {"threshold_px": 10.0, "threshold_m": 0.05}),
        (WeightedSubsetsOptions, {"target_px": 5.0, "target_normalized": 0.01}),
    ],
)
def test_limits_in_two_units_are_refused(record, given):
    with pytest.raises(OptionsError, match=" and ".join(given) + " are given. Remove one"):
        record(**given)


def test_samples_depend_on_the_seed():
    data = walk(30, 12, outlier_share=0.3)
    few = {"max_iterations": 20}
    one, same, other = (
        triangulate_walk(data, "ransac", ransac=RansacOptions(seed=seed, **few))
        for seed in (1, 1, 2)  # type: ignore[arg-type]
    )
    assert one == same
    assert one != other


def test_min_views_counts_inliers():
    data = walk(60, 4, outlier_share=0.3)
    layer = triangulate_walk(data, "ransac", min_views=3)
    assert layer.n_views[layer.has_point].min() >= 3
    assert (layer.status == PointStatus.OUTLIER).any()
