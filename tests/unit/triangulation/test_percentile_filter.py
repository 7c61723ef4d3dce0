"""The method percentile_filter against its description."""

import itertools
import tracemalloc

import numpy as np
import pytest
from benchmarks.walking import walk

from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import (
    PercentileFilterOptions,
    TriangulationOptions,
)
from posefuse.model.status import ViewStatus
from posefuse.model.tracks import Tracks, TrackState
from posefuse.pipeline.reconstruct import triangulate
from posefuse.triangulation import percentile_filter
from tests.reference import rejection

from .conftest import triangulate_walk

REFERENCE_CASES = ((4, 0.1, 0.0, 3, 1), (5, 0.1, 0.1, 3, 1), (5, 0.15, 0.0, 2, 2), (6, 0.1, 0.2, 3, 2))
NOTE = "does not run"


def test_matches_the_naive_reference():
    data = walk(6, 5, outlier_share=0.12, missing_share=0.08, seed=4)
    options = PercentileFilterOptions(threshold_px=9.0)
    layer = triangulate_walk(data, "percentile_filter", percentile_filter=options)
    expected = [
        [rejection.percentile_filter(data.rig, data.pixels[f, :, k], 9.0, 3) for k in range(26)] for f in range(6)
    ]
    np.testing.assert_allclose(layer.points_m[:, 0], expected, atol=2e-4)


def test_rules_of_the_program_match_the_naive_reference():
    data = walk(8, 6, "barrel", outlier_share=0.12, missing_share=0.1, seed=4)
    layer = triangulate_walk(data, "percentile_filter", min_views=2, freemocap_rules="program")
    pixels = np.moveaxis(data.pixels, 2, 1).reshape(-1, 6, 2)
    expected = rejection.program_percentile_filter(data.rig, pixels, 90.0, 3)
    assert 0.005 < np.isnan(expected[:, 0]).mean() < 0.5
    np.testing.assert_allclose(layer.points_m[:, 0].reshape(-1, 3), expected, atol=1e-6)


def test_program_keeps_points_that_all_views_place_behind_a_camera():
    data = walk(200, 5, outlier_share=0.05, outlier_px=(300.0, 1500.0))
    simple, layer = (
        triangulate_walk(data, method, freemocap_rules="program", min_confidence=0.0, min_views=2)
        for method in ("simple", "percentile_filter")
    )
    missing = ~simple.has_point
    assert missing.sum() > 100
    assert layer.has_point[missing].mean() > 0.2


def test_threshold_is_a_percentile_over_the_whole_recording(ugly):
    result = triangulate(
        ugly.rig, ugly.detections, Options(triangulation=TriangulationOptions(method="percentile_filter"))
    )
    plain = triangulate_walk(ugly, "simple", min_views=3)
    expected = np.percentile(plain.view_error_px[plain.view_status == ViewStatus.USED], 90)
    assert result.resolved.triangulation.percentile_filter.threshold_px == pytest.approx(expected, rel=1e-6)
    assert any("percentile" in note for note in result.provenance.notes)


def test_note_if_no_camera_can_be_dropped():
    data = walk(20, 3)
    result = triangulate(
        data.rig, data.detections, Options(triangulation=TriangulationOptions(method="percentile_filter"))
    )
    assert any("does not run" in note for note in result.provenance.notes)


@pytest.mark.parametrize("left", [2, 3, 4])
def test_views_are_dropped_down_to_min_views_left_whatever_min_views_is(left):
    data = walk(20, 5, outlier_share=0.3, seed=7)
    options = PercentileFilterOptions(threshold_px=5.0, min_views_left=left)
    layer = triangulate_walk(data, "percentile_filter", min_views=3, percentile_filter=options)
    n_views = layer.n_views[layer.has_point]
    assert set(n_views.tolist()) == set(range(left, 6))


def test_threshold_is_the_same_for_ranges_of_any_size(monkeypatch):
    data = walk(50, 4, outlier_share=0.1)
    options = Options(pairs="labels", triangulation=TriangulationOptions(method="percentile_filter"))
    results = []
    for size in (1, 7, 50):
        monkeypatch.setattr("posefuse.pipeline.reconstruct.CHUNK_FRAMES", size)
        results.append(triangulate(data.rig, data.detections, options))
    assert results[0] == results[1] == results[2]


def test_preparation_keeps_no_range_of_frames_in_memory():
    data = walk(40, 4, outlier_share=0.1)
    tracks = Tracks(("person_1",), np.zeros((40, 1, 4), np.int32), np.full((40, 1), TrackState.ACTIVE, np.int8))
    options = TriangulationOptions(method="percentile_filter", min_views=3)
    noise = NoiseModel(np.full(4, 2.0))

    def peak_bytes(repetitions: int) -> int:
        tracemalloc.start()
        piece = (data.detections, tracks)
        percentile_filter.prepare(data.rig, lambda: itertools.repeat(piece, repetitions), noise, options)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    peak_bytes(1)
    assert peak_bytes(200) < 1.1 * peak_bytes(5)


@pytest.mark.long
@pytest.mark.parametrize(("cameras", "share", "missing", "min_views", "max_drop"), REFERENCE_CASES)
def test_ten_thousand_points_match_the_reference(cameras, share, missing, min_views, max_drop):
    data = walk(97, cameras, outlier_share=share, missing_share=missing, seed=cameras)
    options = PercentileFilterOptions(threshold_px=9.0, min_views_left=min_views)
    layer = triangulate_walk(data, "percentile_filter", min_views=min_views, percentile_filter=options)
    assert_matches_reference(data, layer, lambda pixels: rejection.percentile_filter(data.rig, pixels, 9.0, min_views))


@pytest.mark.filterwarnings("ignore:min_views lowered")
@pytest.mark.parametrize(("cameras", "min_views", "left"), [(2, None, 3), (3, None, 3), (3, 5, 3), (4, 2, 4)])
def test_one_note_and_the_points_of_simple_if_no_camera_can_be_dropped(cameras, min_views, left):
    data = walk(20, cameras, outlier_share=0.05)
    threshold = PercentileFilterOptions(threshold_px=10.0, min_views_left=left)
    chosen = TriangulationOptions(method="percentile_filter", min_views=min_views, percentile_filter=threshold)
    result = triangulate(data.rig, data.detections, Options(triangulation=chosen))
    assert sum(NOTE in note for note in result.provenance.notes) == 1
    assert result.layers["measured"] == triangulate_walk(data, "simple", min_views=min_views)


@pytest.mark.parametrize(("cameras", "left"), [(4, 3), (3, 2)])
def test_no_note_if_cameras_can_be_dropped(cameras, left):
    data = walk(20, cameras)
    options = PercentileFilterOptions(min_views_left=left)
    chosen = TriangulationOptions(method="percentile_filter", percentile_filter=options)
    result = triangulate(data.rig, data.detections, Options(triangulation=chosen))
    assert not any(NOTE in note for note in result.provenance.notes)


def test_no_note_for_a_single_camera():
    data = walk(5, 3)
    chosen = Options(cameras=(data.rig.names[0],), triangulation=TriangulationOptions(method="percentile_filter"))
    result = triangulate(data.rig, data.detections, chosen)
    assert not any(NOTE in note for note in result.provenance.notes)


def assert_matches_reference(data, layer, reference):
    frames = len(data.pixels)
    expected = np.array([[reference(data.pixels[f, :, k]) for k in range(26)] for f in range(frames)])
    actual = layer.points_m[:, 0]
    np.testing.assert_array_equal(np.isnan(actual), np.isnan(expected))
    # The solvers stop within a hundredth of a standard error of each other.
    np.testing.assert_allclose(actual, expected, atol=2e-4)
