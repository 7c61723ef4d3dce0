"""The method consensus: rejected views, ambiguity, and its cost function."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.walking import Walk, walk

from posefuse.errors import OptionsError
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import (
    ConsensusOptions,
)
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.pipeline.reconstruct import triangulate
from posefuse.triangulation.consensus import reweighting_loss
from tests.scenes import ring, skeleton_of

from .conftest import errors_mm, triangulate_walk


def bounded_cost(data: Walk, points_m: np.ndarray, sigma_px: np.ndarray) -> np.ndarray:
    """Return the cost that consensus minimizes, in squared standard deviations, shape (frame, keypoint)."""
    full, zero = 2.5**2, 5.0**2
    projected = data.rig.project(points_m)
    squared = (np.square(projected - data.pixels).sum(axis=-1)) / np.square(sigma_px[:, None])
    weight_root = 1.0 - np.clip((squared - full) / (zero - full), 0.0, 1.0)
    return (np.minimum(squared, full) + (zero - full) * (1.0 - weight_root**3) / 3.0).sum(axis=1)


def test_result_is_a_minimum_of_the_bounded_cost(ugly):
    """The minimum holds also where residuals lie in the range of falling weights."""
    result = triangulate(ugly.rig, ugly.detections, Options(pairs="labels", noise_scale_px=2.0))
    layer = result.layers["measured"]
    points, present = layer.points_m[:, 0], layer.has_point[:, 0]
    lowest = bounded_cost(ugly, points, result.noise.scale_px)
    between = ((layer.view_error_px > 5.0) & (layer.view_error_px < 10.0)).any(axis=-1)[:, 0]
    assert (between & present).sum() > 100
    for axis in np.eye(3):
        step = 0.05 * layer.sd_m[:, 0] * axis
        for sign in (1, -1):
            assert (bounded_cost(ugly, points + sign * step, result.noise.scale_px) > lowest)[present].all()


@pytest.mark.parametrize(("cameras", "share"), [(5, 0.05), (8, 0.4), (16, 0.4)])
def test_outlier_views_are_rejected(cameras, share):
    data = walk(40, cameras, outlier_share=share)
    layer = triangulate_walk(data, "consensus")
    judged = data.inlier.sum(axis=1) >= 4
    rejected = np.moveaxis(layer.view_status[:, 0] == ViewStatus.OUTLIER, -1, 1)
    wrong = ~data.inlier & judged[:, None]
    assert rejected[wrong].mean() > 0.99
    assert rejected[data.inlier & judged[:, None]].mean() < 0.01


@pytest.mark.parametrize("size_px", [5.0, 8.0, 10.0, 14.0, 20.0, 40.0, 100.0, 400.0])
def test_outliers_of_any_size_are_handled(size_px):
    """One camera of five is an outlier at every point; the mean error stays within 1.3 times that of the other four."""
    data = walk(300)
    rng = np.random.default_rng(1)
    view = rng.integers(0, 5, (300, 26))
    angle = rng.uniform(0, 2 * np.pi, view.shape)
    pixels = data.pixels.copy()
    f, k = np.indices(view.shape)
    pixels[f, view, k] += size_px * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    good = pixels.copy()
    good[f, view, k] = np.nan
    floor = errors_mm(data, triangulate_walk(replace(data, pixels=good), "simple")).mean()
    layer = triangulate_walk(replace(data, pixels=pixels), "consensus")
    assert np.nanmean(errors_mm(data, layer)) < 1.3 * floor
    assert layer.has_point.mean() > 0.999


@pytest.mark.filterwarnings("ignore:The views do not agree")
def test_two_equal_consensus_sets_are_undecided():
    """Four views see one point and four another."""
    rig = ring(8)
    one, other = np.array([[0.2, 0.1, 1.0]]), np.array([[-0.3, 0.0, 1.2]])
    pixels = np.concatenate([rig.project(one)[:, :4], rig.project(other)[:, 4:]], axis=1)[:, :, None]
    pixels = pixels + np.random.default_rng(0).normal(0, 1.0, pixels.shape)
    detections = Detections.from_dense(skeleton_of(1), rig.names, pixels)
    layer = triangulate(rig, detections, Options(noise_scale_px=1.0)).layers["measured"]
    assert layer.status[0, 0, 0] == PointStatus.UNDECIDED
    assert np.isnan(layer.points_m).all()


@pytest.mark.filterwarnings("ignore:The views do not agree")
def test_doubtful_statuses_predict_wrong_points():
    data = walk(400, outlier_share=0.4)
    layer = triangulate_walk(data, "consensus")
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
def test_two_contradicting_views_give_no_point():
    rig = ring(5).select(["cam_0", "cam_1"])
    pixels = rig.project(np.array([[[0.2, 0.1, 1.0]]]))
    pixels[0, 1] += [0.0, 150.0]
    detections = Detections.from_dense(skeleton_of(1), rig.names, pixels)
    layer = triangulate(rig, detections, Options(noise_scale_px=2.0)).layers["measured"]
    assert layer.status[0, 0, 0] == PointStatus.OUTLIER
    assert np.isnan(layer.points_m).all()


def test_three_views_with_one_outlier_are_flagged():
    data = walk(400, 3, outlier_share=0.2, missing_share=0.2)
    layer = triangulate_walk(data, "consensus")
    wrong = errors_mm(data, layer) > 100
    flagged = np.isin(layer.status[:, 0], (PointStatus.AMBIGUOUS, PointStatus.TWO_VIEWS, PointStatus.WEAK_GEOMETRY))
    assert flagged[wrong].mean() > 0.8


def test_reweighting_is_98_percent_efficient():
    assert 1.0 < reweighting_loss(2.5, 5.0) < 1.02
    assert reweighting_loss(8.0, 9.0) == pytest.approx(1.0, abs=1e-4)
    assert reweighting_loss(1.0, 2.0) > 1.5


def test_limits_must_be_ordered():
    with pytest.raises(OptionsError, match="below zero_weight_sigma"):
        ConsensusOptions(full_weight_sigma=5.0, zero_weight_sigma=3.0)
    with pytest.raises(OptionsError, match="saturation_sigma must be a finite number above 0"):
        ConsensusOptions(saturation_sigma=0.0)
