"""The method weighted_subsets against its description."""

import numpy as np
import pytest
from benchmarks.walking import walk

from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import (
    PercentileFilterOptions,
    TriangulationOptions,
    WeightedSubsetsOptions,
)
from posefuse.model.status import ViewStatus
from posefuse.pipeline.reconstruct import triangulate
from tests.reference import rejection

from .conftest import errors_mm, triangulate_walk

REFERENCE_CASES = ((4, 0.1, 0.0, 3, 1), (5, 0.1, 0.1, 3, 1), (5, 0.15, 0.0, 2, 2), (6, 0.1, 0.2, 3, 2))
NOTE = "weighted_subsets drops no camera"


@pytest.mark.parametrize(("max_drop", "min_views"), [(1, 3), (2, 3), (2, 2)])
def test_matches_the_naive_reference(max_drop, min_views):
    data = walk(6, 5, outlier_share=0.12, missing_share=0.08, seed=4)
    options = WeightedSubsetsOptions(max_cameras_to_drop=max_drop)
    layer = triangulate_walk(data, "weighted_subsets", min_views=min_views, weighted_subsets=options)
    expected = [
        [rejection.weighted_subsets(data.rig, data.pixels[f, :, k], 10.0, max_drop, min_views) for k in range(26)]
        for f in range(6)
    ]
    np.testing.assert_allclose(layer.points_m[:, 0], expected, atol=2e-4)


@pytest.mark.parametrize(("max_drop", "min_views", "target"), [(1, 3, 0.01), (2, 2, 0.01), (1, 3, 0.0005)])
def test_rules_of_the_program_match_the_naive_reference(max_drop, min_views, target):
    data = walk(6, 5, "barrel", outlier_share=0.15, missing_share=0.08, seed=4)
    options = WeightedSubsetsOptions(target_normalized=target, max_cameras_to_drop=max_drop)
    layer = triangulate_walk(
        data, "weighted_subsets", min_views=min_views, weighted_subsets=options, freemocap_rules="program"
    )
    expected = [
        [
            rejection.program_weighted_subsets(data.rig, data.pixels[f, :, k], target, max_drop, min_views)
            for k in range(26)
        ]
        for f in range(6)
    ]
    np.testing.assert_allclose(layer.points_m[:, 0], expected, atol=1e-6)


@pytest.mark.parametrize("rules", ["documentation", "program"])
def test_points_that_all_views_do_not_determine_are_found_from_fewer(rules):
    data = walk(200, 4, outlier_share=0.1, outlier_px=(300.0, 1500.0))
    simple, layer = (
        triangulate_walk(data, method, freemocap_rules=rules, min_confidence=0.0)
        for method in ("simple", "weighted_subsets")
    )
    missing = ~simple.has_point
    assert missing.sum() > 10
    assert layer.has_point[missing].mean() > 0.8


def test_normalized_units():
    data = walk(40, outlier_share=0.1)
    in_px = WeightedSubsetsOptions(target_px=12.0)
    focal = data.rig.cameras[0].matrix[0, 0]
    normalized = WeightedSubsetsOptions(target_normalized=12.0 / focal)
    one = triangulate_walk(data, "weighted_subsets", weighted_subsets=in_px)
    other = triangulate_walk(data, "weighted_subsets", weighted_subsets=normalized)
    np.testing.assert_allclose(one.points_m, other.points_m, atol=1e-6)


def test_dropped_camera_is_reported():
    data = walk(30, outlier_share=0.05)
    layer = triangulate_walk(data, "weighted_subsets")
    off = data.inlier.sum(axis=1) == 4
    large = off & (errors_mm(data, triangulate_walk(data, "simple")) > 60)
    rejected = np.moveaxis(layer.view_status[:, 0] == ViewStatus.OUTLIER, -1, 1)
    np.testing.assert_array_equal(rejected.transpose(0, 2, 1)[large], ~data.inlier.transpose(0, 2, 1)[large])


@pytest.mark.long
@pytest.mark.parametrize(("cameras", "share", "missing", "min_views", "max_drop"), REFERENCE_CASES)
def test_ten_thousand_points_match_the_reference(cameras, share, missing, min_views, max_drop):
    data = walk(97, cameras, outlier_share=share, missing_share=missing, seed=cameras)
    options = WeightedSubsetsOptions(max_cameras_to_drop=max_drop)
    layer = triangulate_walk(data, "weighted_subsets", min_views=min_views, weighted_subsets=options)
    assert_matches_reference(
        data, layer, lambda pixels: rejection.weighted_subsets(data.rig, pixels, 10.0, max_drop, min_views)
    )


@pytest.mark.filterwarnings("ignore:min_views lowered")
@pytest.mark.parametrize(("cameras", "min_views"), [(2, None), (3, None), (3, 5), (4, 4)])
def test_one_note_and_the_points_of_simple_if_no_camera_can_be_dropped(cameras, min_views):
    data = walk(20, cameras, outlier_share=0.05)
    threshold = PercentileFilterOptions(threshold_px=10.0)
    chosen = TriangulationOptions(method="weighted_subsets", min_views=min_views, percentile_filter=threshold)
    result = triangulate(data.rig, data.detections, Options(triangulation=chosen))
    assert sum(NOTE in note for note in result.provenance.notes) == 1
    assert result.layers["measured"] == triangulate_walk(data, "simple", min_views=min_views)


@pytest.mark.parametrize(("cameras", "min_views"), [(4, None), (3, 2)])
def test_no_note_if_cameras_can_be_dropped(cameras, min_views):
    data = walk(20, cameras)
    chosen = TriangulationOptions(method="weighted_subsets", min_views=min_views)
    result = triangulate(data.rig, data.detections, Options(triangulation=chosen))
    assert not any(NOTE in note for note in result.provenance.notes)


def test_no_note_for_a_single_camera():
    data = walk(5, 3)
    chosen = Options(cameras=(data.rig.names[0],), triangulation=TriangulationOptions(method="weighted_subsets"))
    result = triangulate(data.rig, data.detections, chosen)
    assert not any(NOTE in note for note in result.provenance.notes)


def assert_matches_reference(data, layer, reference):
    frames = len(data.pixels)
    expected = np.array([[reference(data.pixels[f, :, k]) for k in range(26)] for f in range(frames)])
    actual = layer.points_m[:, 0]
    np.testing.assert_array_equal(np.isnan(actual), np.isnan(expected))
    # The solvers stop within a hundredth of a standard error of each other.
    np.testing.assert_allclose(actual, expected, atol=2e-4)
