"""Every method on the same ugly data: what it rejects, what it says, and that it is what its description says."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.walking import Walk, walk

from posefuse.errors import OptionsError
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import (
    METHODS,
    ConsensusOptions,
    PercentileFilterOptions,
    RansacOptions,
    TriangulationOptions,
    WeightedSubsetsOptions,
)
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.pipeline.reconstruct import triangulate
from posefuse.triangulation.consensus import reweighting_loss
from tests.reference import rejection
from tests.scenes import ring, skeleton_of


def solved(data: Walk, method: str, **options: object) -> Layer:
    chosen = TriangulationOptions(method=method, **options)  # type: ignore[arg-type]
    return triangulate(data.rig, data.detections, Options(pairs="labels", triangulation=chosen)).layers["measured"]


def errors_mm(data: Walk, layer: Layer) -> np.ndarray:
    return 1000 * np.linalg.norm(layer.points_m[:, 0] - data.points_m, axis=-1)


@pytest.fixture(scope="module")
def clean() -> Walk:
    return walk(60)


@pytest.fixture(scope="module")
def ugly() -> Walk:
    return walk(120, outlier_share=0.05)


@pytest.mark.parametrize("method", METHODS)
def test_all_agree_on_clean_data(method, clean):
    layer = solved(clean, method)
    reference = np.median(errors_mm(clean, solved(clean, "simple")))
    worst = {"percentile_filter": 1.4, "midpoint": 1.1, "ransac": 1.03, "irls": 1.05}.get(method, 1.02)
    assert np.nanmedian(errors_mm(clean, layer)) < worst * reference
    assert layer.has_point.mean() > (0.97 if method == "percentile_filter" else 0.999)


@pytest.mark.parametrize("method", METHODS)
def test_numbers_status_and_views_tell_the_same(method, ugly):
    layer = solved(ugly, method)
    np.testing.assert_array_equal(np.isfinite(layer.points_m).all(axis=-1), layer.has_point)
    np.testing.assert_array_equal(np.isfinite(layer.covariance_m2).all(axis=-1), layer.has_point)
    used = layer.view_status == ViewStatus.USED
    np.testing.assert_array_equal(used.any(axis=-1), layer.has_point)
    mean = np.where(used, layer.view_error_px, 0).sum(axis=-1) / np.maximum(used.sum(axis=-1), 1)
    np.testing.assert_allclose(layer.reprojection_error_px[layer.has_point], mean[layer.has_point], rtol=1e-4)


def bounded_cost(data: Walk, points_m: np.ndarray, sigma_px: np.ndarray) -> np.ndarray:
    """Shape (frame, keypoint): what consensus minimises at last, in squared sigmas, by its description."""
    full, none = 2.5**2, 5.0**2
    projected = np.moveaxis(data.rig.project(points_m), 0, 1)
    squared = (np.square(projected - data.pixels).sum(axis=-1)) / np.square(sigma_px[:, None])
    fall = 1.0 - np.clip((squared - full) / (none - full), 0.0, 1.0)
    return (np.minimum(squared, full) + (none - full) * (1.0 - fall**3) / 3.0).sum(axis=1)


def test_consensus_ends_in_a_minimum_of_the_bounded_cost(ugly):
    """Where weights fall, too: there the second derivatives are those of the cost, not of its squares."""
    result = triangulate(ugly.rig, ugly.detections, Options(pairs="labels", noise_scale_px=2.0))
    layer = result.layers["measured"]
    points, there = layer.points_m[:, 0], layer.has_point[:, 0]
    lowest = bounded_cost(ugly, points, result.noise.scale_px)
    between = ((layer.view_error_px > 5.0) & (layer.view_error_px < 10.0)).any(axis=-1)[:, 0]
    assert (between & there).sum() > 100
    for axis in np.eye(3):
        step = 0.05 * layer.sd_m[:, 0] * axis
        for sign in (1, -1):
            assert (bounded_cost(ugly, points + sign * step, result.noise.scale_px) > lowest)[there].all()


@pytest.mark.parametrize(
    ("method", "far_share"),
    [("consensus", 0.0005), ("ransac", 0.002), ("irls", 0.02), ("weighted_subsets", 0.04), ("percentile_filter", 0.04)],
)
def test_robust_methods_are(method, far_share, ugly):
    judged = ugly.inlier.sum(axis=1) >= 3
    far = errors_mm(ugly, solved(ugly, method))[judged] > 50
    assert far.mean() <= far_share
    assert (errors_mm(ugly, solved(ugly, "simple"))[judged] > 50).mean() > 0.15


class TestConsensus:
    @pytest.mark.parametrize(("cameras", "share"), [(5, 0.05), (8, 0.4), (16, 0.4)])
    def test_wrong_views_are_named(self, cameras, share):
        data = walk(40, cameras, outlier_share=share)
        layer = solved(data, "consensus")
        judged = data.inlier.sum(axis=1) >= 4
        named = np.moveaxis(layer.view_status[:, 0] == ViewStatus.OUTLIER, -1, 1)
        wrong = ~data.inlier & judged[:, None]
        assert named[wrong].mean() > 0.99
        assert named[data.inlier & judged[:, None]].mean() < 0.01

    @pytest.mark.parametrize("size_px", [5.0, 8.0, 10.0, 14.0, 20.0, 40.0, 100.0, 400.0])
    def test_no_size_of_one_wrong_view_is_a_blind_zone(self, size_px):
        """One bad camera of five at every point: the mean error stays within 1.3 times that of the four good ones."""
        data = walk(300)
        rng = np.random.default_rng(1)
        view = rng.integers(0, 5, (300, 26))
        angle = rng.uniform(0, 2 * np.pi, view.shape)
        pixels = data.pixels.copy()
        f, k = np.indices(view.shape)
        pixels[f, view, k] += size_px * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        good = pixels.copy()
        good[f, view, k] = np.nan
        floor = errors_mm(data, solved(replace(data, pixels=good), "simple")).mean()
        layer = solved(replace(data, pixels=pixels), "consensus")
        assert np.nanmean(errors_mm(data, layer)) < 1.3 * floor
        assert layer.has_point.mean() > 0.999

    @pytest.mark.filterwarnings("ignore:The views do not agree")
    def test_two_answers_are_said_to_be_two(self):
        """Four views see one point and four another."""
        rig = ring(8)
        one, other = np.array([[0.2, 0.1, 1.0]]), np.array([[-0.3, 0.0, 1.2]])
        pixels = np.concatenate([rig.project(one)[:4], rig.project(other)[4:]])[None]
        pixels = pixels + np.random.default_rng(0).normal(0, 1.0, pixels.shape)
        detections = Detections.from_dense(skeleton_of(1), rig.names, pixels)
        layer = triangulate(rig, detections, Options(noise_scale_px=1.0)).layers["measured"]
        assert layer.status[0, 0, 0] == PointStatus.UNDECIDED
        assert np.isnan(layer.points_m).all()

    @pytest.mark.filterwarnings("ignore:The views do not agree")
    def test_doubt_is_where_points_are_wrong(self):
        data = walk(400, outlier_share=0.4)
        layer = solved(data, "consensus")
        status, wrong = layer.status[:, 0], errors_mm(data, layer) > 50
        judged = data.inlier.sum(axis=1) >= 3
        doubtful = np.isin(status, (PointStatus.AMBIGUOUS, PointStatus.TWO_VIEWS))
        assert wrong[doubtful].mean() > 0.1
        assert wrong[status == PointStatus.OK].mean() < 0.002
        undecided = status == PointStatus.UNDECIDED
        assert undecided.any()
        assert np.isnan(layer.points_m[:, 0][undecided]).all()
        assert undecided[judged].mean() < 0.003

    @pytest.mark.filterwarnings("ignore:The views do not agree")
    def test_views_that_contradict_each_other_give_no_point(self):
        rig = ring(5).select(["cam_0", "cam_1"])
        pixels = rig.project(np.array([[0.2, 0.1, 1.0]]))[None].copy()
        pixels[0, 1] += [0.0, 150.0]
        detections = Detections.from_dense(skeleton_of(1), rig.names, pixels)
        layer = triangulate(rig, detections, Options(noise_scale_px=2.0)).layers["measured"]
        assert layer.status[0, 0, 0] == PointStatus.OUTLIER
        assert np.isnan(layer.points_m).all()

    def test_three_views_with_one_wrong_do_not_invent(self):
        data = walk(400, 3, outlier_share=0.2, missing_share=0.2)
        layer = solved(data, "consensus")
        wrong = errors_mm(data, layer) > 100
        flagged = np.isin(layer.status[:, 0], (PointStatus.AMBIGUOUS, PointStatus.TWO_VIEWS, PointStatus.WEAK_GEOMETRY))
        assert flagged[wrong].mean() > 0.8

    def test_the_kernel_is_98_per_cent_efficient(self):
        assert 1.0 < reweighting_loss(2.5, 5.0) < 1.02
        assert reweighting_loss(8.0, 9.0) == pytest.approx(1.0, abs=1e-4)
        assert reweighting_loss(1.0, 2.0) > 1.5

    def test_the_limits_must_be_in_order(self):
        with pytest.raises(OptionsError, match="below zero_weight_sigma"):
            ConsensusOptions(full_weight_sigma=5.0, zero_weight_sigma=3.0)
        with pytest.raises(OptionsError, match="saturation_sigma must be a finite number above 0"):
            ConsensusOptions(saturation_sigma=0.0)


class TestWeightedSubsets:
    @pytest.mark.parametrize(("max_drop", "min_views"), [(1, 3), (2, 3), (2, 2)])
    def test_equals_the_words(self, max_drop, min_views):
        data = walk(6, 5, outlier_share=0.12, missing_share=0.08, seed=4)
        options = WeightedSubsetsOptions(max_cameras_to_drop=max_drop)
        layer = solved(data, "weighted_subsets", min_views=min_views, weighted_subsets=options)
        expected = [
            [rejection.weighted_subsets(data.rig, data.pixels[f, :, k], 10.0, max_drop, min_views) for k in range(26)]
            for f in range(6)
        ]
        np.testing.assert_allclose(layer.points_m[:, 0], expected, atol=2e-4)

    def test_normalised_units(self):
        data = walk(40, outlier_share=0.1)
        in_px = WeightedSubsetsOptions(target_reprojection_error=12.0)
        focal = data.rig.cameras[0].matrix[0, 0]
        normalised = WeightedSubsetsOptions(target_reprojection_error=12.0 / focal, target_unit="normalised")
        one = solved(data, "weighted_subsets", weighted_subsets=in_px)
        other = solved(data, "weighted_subsets", weighted_subsets=normalised)
        np.testing.assert_allclose(one.points_m, other.points_m, atol=1e-6)

    def test_the_dropped_camera_is_named(self):
        data = walk(30, outlier_share=0.05)
        layer = solved(data, "weighted_subsets")
        off = data.inlier.sum(axis=1) == 4
        large = off & (errors_mm(data, solved(data, "simple")) > 60)
        named = np.moveaxis(layer.view_status[:, 0] == ViewStatus.OUTLIER, -1, 1)
        np.testing.assert_array_equal(named.transpose(0, 2, 1)[large], ~data.inlier.transpose(0, 2, 1)[large])


class TestPercentileFilter:
    def test_equals_the_words(self):
        data = walk(6, 5, outlier_share=0.12, missing_share=0.08, seed=4)
        options = PercentileFilterOptions(threshold_px=9.0)
        layer = solved(data, "percentile_filter", percentile_filter=options)
        expected = [
            [rejection.percentile_filter(data.rig, data.pixels[f, :, k], 9.0, 3) for k in range(26)] for f in range(6)
        ]
        np.testing.assert_allclose(layer.points_m[:, 0], expected, atol=2e-4)

    def test_the_threshold_is_of_the_whole_recording(self, ugly):
        result = triangulate(
            ugly.rig, ugly.detections, Options(triangulation=TriangulationOptions(method="percentile_filter"))
        )
        plain = solved(ugly, "simple", min_views=3)
        expected = np.percentile(plain.view_error_px[plain.view_status == ViewStatus.USED], 90)
        assert result.options.triangulation.percentile_filter.threshold_px == pytest.approx(expected, rel=1e-6)
        assert any("percentile" in note for note in result.provenance.notes)

    def test_it_says_where_it_does_not_run(self):
        data = walk(20, 3)
        result = triangulate(
            data.rig, data.detections, Options(triangulation=TriangulationOptions(method="percentile_filter"))
        )
        assert any("does not run" in note for note in result.provenance.notes)


@pytest.mark.long
class TestTwins:
    """Ten thousand points each; frames of 26 keypoints, 4 to 6 views, some missing."""

    CASES = ((4, 0.1, 0.0, 3, 1), (5, 0.1, 0.1, 3, 1), (5, 0.15, 0.0, 2, 2), (6, 0.1, 0.2, 3, 2))

    @pytest.mark.parametrize(("cameras", "share", "missing", "min_views", "max_drop"), CASES)
    def test_weighted_subsets(self, cameras, share, missing, min_views, max_drop):
        data = walk(97, cameras, outlier_share=share, missing_share=missing, seed=cameras)
        options = WeightedSubsetsOptions(max_cameras_to_drop=max_drop)
        layer = solved(data, "weighted_subsets", min_views=min_views, weighted_subsets=options)
        compare_with_twin(
            data, layer, lambda pixels: rejection.weighted_subsets(data.rig, pixels, 10.0, max_drop, min_views)
        )

    @pytest.mark.parametrize(("cameras", "share", "missing", "min_views", "max_drop"), CASES)
    def test_percentile_filter(self, cameras, share, missing, min_views, max_drop):
        data = walk(97, cameras, outlier_share=share, missing_share=missing, seed=cameras)
        options = PercentileFilterOptions(threshold_px=9.0)
        layer = solved(data, "percentile_filter", min_views=min_views, percentile_filter=options)
        compare_with_twin(data, layer, lambda pixels: rejection.percentile_filter(data.rig, pixels, 9.0, min_views))


def compare_with_twin(data, layer, twin):
    frames = len(data.pixels)
    expected = np.array([[twin(data.pixels[f, :, k]) for k in range(26)] for f in range(frames)])
    found = layer.points_m[:, 0]
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    # The solvers stop within a hundredth of a standard error of each other.
    np.testing.assert_allclose(found, expected, atol=2e-4)


WORDS = {"weighted_subsets": "weighted_subsets drops no camera", "percentile_filter": "does not run"}


class TestNothingToDrop:
    """As many cameras as a point needs: said once, in the result, and the points are those of simple."""

    @pytest.mark.filterwarnings("ignore:min_views lowered")
    @pytest.mark.parametrize(("cameras", "min_views"), [(2, None), (3, None), (3, 5), (4, 4)])
    @pytest.mark.parametrize("method", WORDS)
    def test_it_is_said_once(self, method, cameras, min_views):
        data = walk(20, cameras, outlier_share=0.05)
        threshold = PercentileFilterOptions(threshold_px=10.0)
        chosen = TriangulationOptions(method=method, min_views=min_views, percentile_filter=threshold)
        result = triangulate(data.rig, data.detections, Options(triangulation=chosen))
        assert sum(WORDS[method] in note for note in result.provenance.notes) == 1
        assert result.layers["measured"] == solved(data, "simple", min_views=min_views)

    @pytest.mark.parametrize(("cameras", "min_views"), [(4, None), (3, 2)])
    @pytest.mark.parametrize("method", WORDS)
    def test_it_is_not_said_where_there_is(self, method, cameras, min_views):
        data = walk(20, cameras)
        chosen = TriangulationOptions(method=method, min_views=min_views)
        result = triangulate(data.rig, data.detections, Options(triangulation=chosen))
        assert not any(WORDS[method] in note for note in result.provenance.notes)

    @pytest.mark.parametrize("method", WORDS)
    def test_one_camera_is_another_matter(self, method):
        data = walk(5, 3)
        chosen = Options(cameras=(data.rig.names[0],), triangulation=TriangulationOptions(method=method))
        result = triangulate(data.rig, data.detections, chosen)
        assert not any(WORDS[method] in note for note in result.provenance.notes)


class TestRansac:
    def test_metres_do_as_pixels_do(self):
        data = walk(60, 6, outlier_share=0.1)
        layer = solved(data, "ransac", ransac=RansacOptions(threshold=0.06, threshold_unit="m"))
        judged = data.inlier.sum(axis=1) >= 3
        assert (errors_mm(data, layer)[judged] > 60).mean() < 0.01

    def test_draws_are_seeded(self):
        data = walk(30, 12, outlier_share=0.3)
        few = {"max_iterations": 20}
        one, same, other = (
            solved(data, "ransac", ransac=RansacOptions(seed=seed, **few))
            for seed in (1, 1, 2)  # type: ignore[arg-type]
        )
        assert one == same
        assert one != other

    def test_three_means_three(self):
        data = walk(60, 4, outlier_share=0.3)
        layer = solved(data, "ransac", min_views=3)
        assert layer.n_views[layer.has_point].min() >= 3
        assert (layer.status == PointStatus.OUTLIER).any()
