"""Figures of accuracy, on cases worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import ResultError
from posefuse.evaluation.accuracy import (
    bone_variation,
    evaluate,
    interpolated,
    truth_from_result,
    truth_from_trajectories,
)
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate, truth_of
from tests.scenes import ring, skeleton_of


def result_of_points(points: np.ndarray) -> Reconstruction:
    """Points (frame, keypoint, 3) as a result."""
    return truth_of(ring(3), skeleton_of(points.shape[1]), points, 30.0)


@pytest.fixture
def truth(rng) -> Reconstruction:
    return result_of_points(rng.normal(size=(10, 4, 3)))


def moved(result: Reconstruction, offset: np.ndarray) -> Reconstruction:
    layer = result.layers["measured"]
    return replace(result, layers={"measured": replace(layer, points_m=layer.points_m + offset)})


def test_distances_and_percentiles(truth):
    offset = np.zeros((10, 1, 4, 3))
    offset[..., 0] = 0.01
    offset[:2, 0, 0] = [0.0, 0.06, 0.08]
    actual = evaluate(moved(truth, offset), truth_from_result(truth, truth))
    assert actual.n_points == 40
    assert actual.mpjpe_mm == pytest.approx((38 * 10 + 2 * 100) / 40)
    assert actual.median_mm == pytest.approx(10)
    assert actual.p99_mm == pytest.approx(100)
    assert actual.share_beyond_50_mm == pytest.approx(2 / 40)
    assert actual.median_mm_of["point_3"] == pytest.approx(10)
    assert actual.covered_68 is None


def test_missing_points_are_counted_not_averaged(truth):
    offset = np.zeros((10, 1, 4, 3))
    offset[3:5, 0, 1] = np.nan
    actual = evaluate(moved(truth, offset), truth_from_result(truth, truth))
    assert actual.n_points == 38
    assert actual.mpjpe_mm == 0
    assert actual.missing_share == pytest.approx(2 / 40)
    assert actual.missing_share_of["point_1"] == pytest.approx(0.2)


def test_keypoints_without_truth_are_not_missing(truth, rng):
    points = np.array(truth.layers["measured"].points_m)[:, 0]
    points[:, 2] = np.nan
    actual = evaluate(truth, truth_from_result(truth, result_of_points(points)))
    assert actual.n_points == 30
    assert actual.missing_share == 0


def test_coverage_of_a_real_reconstruction():
    scene = simulate(SceneOptions(duration_s=8, detector=CLEAN))
    result = reconstruct(scene.rig, scene.detections, Options(solve="frame"))
    actual = evaluate(result, truth_from_result(result, scene.truth))
    assert actual.covered_68 == pytest.approx(0.68, abs=0.025)
    assert actual.covered_95 == pytest.approx(0.95, abs=0.015)
    assert actual.reprojection_median_px == pytest.approx(2.0, rel=0.05)
    assert actual.matched_by == "frame number"


def test_bone_lengths(rng):
    lengths = 0.4 * (1 + 0.02 * rng.standard_normal(4000))
    points = np.zeros((4000, 3, 3))
    points[:, 1, 0] = lengths
    points[:, 2, 1] = 1.0
    assert bone_variation(points, np.array([[0, 1]])) == pytest.approx(0.02, rel=0.05)
    assert bone_variation(points, np.array([[0, 1], [0, 2], [1, 2]])) < 0.02
    assert bone_variation(np.full((5, 2, 3), np.nan), np.array([[0, 1]])) is None


def test_frames_by_number(truth):
    later = replace(truth, frame_numbers=truth.frame_numbers + 4)
    actual = evaluate(later, truth_from_result(later, truth))
    assert actual.n_points == 6 * 4
    with pytest.raises(ResultError, match="share no frame number"):
        truth_from_result(replace(truth, frame_numbers=truth.frame_numbers + 100), truth)


def test_keypoints_by_name(truth):
    other = replace(truth, skeleton=replace(truth.skeleton, keypoints=("point_0", "b", "c", "point_3"), edges=()))
    assert truth_from_result(truth, other).keypoints == ("point_0", "point_3")
    alien = replace(truth, skeleton=replace(truth.skeleton, keypoints=("a", "b", "c", "d"), edges=()))
    with pytest.raises(ResultError, match="share no keypoint names"):
        truth_from_result(truth, alien)


def test_trajectories_by_order_or_time(truth):
    points = np.array(truth.layers["measured"].points_m)[:, 0]
    same = truth_from_trajectories(truth, ("point_2", "tail"), np.arange(10) / 30 + 5.0, points[:, [2, 0]])
    assert (same.keypoints, same.matched_by) == (("point_2",), "order")
    np.testing.assert_array_equal(same.points_m[:, 0], points[:, 2])
    part = truth_from_trajectories(truth, ("point_2", "Point_2"), np.arange(3, 7) / 30 + 1e-6, points[3:7, [2, 2]])
    assert (part.keypoints, part.matched_by) == (("point_2",), "time")
    assert np.isfinite(part.points_m).all(axis=(1, 2)).tolist() == [False] * 3 + [True] * 4 + [False] * 3
    np.testing.assert_array_equal(part.points_m[3:7, 0], points[3:7, 2])
    with pytest.raises(ResultError, match="is within the truth's times"):
        truth_from_trajectories(truth, ("point_2",), np.arange(4) / 30 + 50, points[:4, [2]])
    with pytest.raises(ResultError, match="at least two increasing times"):
        truth_from_trajectories(truth, ("point_2",), np.zeros(1), points[:1, [2]])
    with pytest.raises(ResultError, match="10 frames without times and the truth has 4"):
        truth_from_trajectories(
            replace(truth, time_s=np.full(10, np.nan)), ("point_2",), np.arange(4) / 30, points[:4, [2]]
        )
    with pytest.raises(ResultError, match="do not occur in skeleton"):
        truth_from_trajectories(truth, ("tail",), np.arange(10) / 30, points[:, [2]])


@pytest.mark.parametrize("rate_hz", [10.0, 20.0, 50.0, 120.0])
def test_truth_may_have_another_rate(rate_hz, truth):
    """A result on a straight line against the same line at another rate: no error of the matching's own."""
    at = np.arange(10) / 30
    line = result_of_points(np.stack([at, 2 * at, -at], axis=-1)[:, None])
    times = np.arange(int(0.3 * rate_hz) + 1) / rate_hz
    actual = truth_from_trajectories(line, ("point_0",), times, np.stack([times, 2 * times, -times], axis=-1)[:, None])
    numbers = evaluate(line, actual)
    assert numbers.mpjpe_mm < 1e-9
    assert numbers.n_points >= 9


def test_nothing_is_interpolated_across_gaps_of_the_truth():
    times = np.array([0.0, 0.1, 0.2, 0.5, 0.6])
    points = np.arange(5.0)[:, None, None] * np.ones(3)
    points[1] = np.nan
    actual = interpolated(points, times, np.array([0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.55, 0.6, 0.7, np.nan]))
    nan = np.nan
    np.testing.assert_allclose(actual[:, 0, 0], [0, nan, nan, nan, 2, nan, 3, 3.5, 4, nan, nan])


def test_nothing_to_compare(truth):
    with pytest.raises(ResultError, match="no common point"):
        evaluate(moved(truth, np.full(3, np.nan)), truth_from_result(truth, truth))
    with pytest.raises(ResultError, match="10 frames, but the result has 5"):
        evaluate(truth.frames(0, 5), truth_from_result(truth, truth))
