"""Numbers of a comparison in scenes with known results."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import DetectionsError
from posefuse.evaluation.accuracy import truth_from_result
from posefuse.evaluation.comparison import SHARES, acceleration_m_s2, method_numbers, spread_of
from posefuse.evaluation.paired_results import people_points
from posefuse.evaluation.people import matched_errors_mm
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import METHODS, TriangulationOptions
from posefuse.pipeline.compare_methods import compare_methods
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.synthetic.scenes import truth_of
from tests.people import simulate_walkers, track_perfectly
from tests.scenes import body_points, ring, simulate_detections, skeleton_of

FRAMES, VIEWS, POINTS = 60, 6, 5
FIXED = Options(noise_scale_px=2.0)


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    return body_points(np.random.default_rng(3), FRAMES, POINTS)


@pytest.fixture(scope="module")
def detections(points) -> Detections:
    """Each point wrong by 200 px in view 0 in every tenth frame, and unseen but for one view in the last."""
    clean = simulate_detections(ring(VIEWS), points, np.random.default_rng(4), rate_hz=60.0)
    pixels, confidence = (np.array(array) for array in clean.dense())
    pixels[::10, 0] += [200.0, 0.0]
    pixels[-1, 1:] = np.nan
    return Detections.from_dense(skeleton_of(POINTS), clean.view_names, pixels, confidence, rate_hz=60.0)


@pytest.fixture(scope="module")
def rows(points, detections):
    truth = truth_of(ring(VIEWS), skeleton_of(POINTS), points, 60.0)
    actual = compare_methods(
        ring(VIEWS),
        detections,
        ["consensus", "simple"],
        FIXED,
        truth_of=lambda result: truth_from_result(result, truth),
    )
    assert (actual.n_frames, actual.n_views, actual.n_keypoints, actual.rate_hz) == (FRAMES, VIEWS, POINTS, 60.0)
    return {row.method: row for row in actual.methods}


def test_consensus_rejects_what_simple_does_not(rows):
    wrong = FRAMES / 10 / ((FRAMES - 1) * VIEWS + 1)
    assert rows["consensus"].rejected_share == pytest.approx(wrong, abs=0.002)
    assert rows["simple"].rejected_share == 0
    assert rows["consensus"].mean_views_used == pytest.approx(VIEWS - 6 / (FRAMES - 1), abs=0.02)
    assert rows["simple"].mean_views_used == VIEWS
    assert rows["consensus"].used_error.p95_px < 6
    assert rows["simple"].used_error.p95_px > 20
    assert rows["simple"].truth_p99_mm > 3 * rows["consensus"].truth_p99_mm


def test_all_detections_are_included(rows):
    """The wrong detections, 6 of 355, and those of the missing points, 1 of 355, stay in it."""
    for row in rows.values():
        at_px = np.array(row.all_error.at_shares_px)
        assert np.isinf(at_px[SHARES > 1 - 0.99 / 355]).all()
        assert np.isfinite(at_px[SHARES < 1 - 1.01 / 355]).all()
    assert rows["consensus"].all_error.at_shares_px[-3] > 150
    assert rows["consensus"].used_error.at_shares_px[-1] < 20
    assert rows["consensus"].all_error.median_px == pytest.approx(rows["consensus"].used_error.median_px, rel=0.05)


def test_missing_points_are_counted(rows):
    for row in rows.values():
        assert row.missing_share == pytest.approx(1 / FRAMES)


def test_time_is_that_of_each_method_and_optional(rows, detections):
    for row in rows.values():
        assert row.cpu_ms_per_frame is not None
        assert 0 < row.cpu_ms_per_frame < 100
    untimed = compare_methods(ring(VIEWS), detections, ["simple"], FIXED, timed=False)
    assert untimed.methods[0].cpu_ms_per_frame is None
    assert untimed.methods[0].truth_median_mm is None


def test_every_method_gets_the_same_noise_and_its_own_min_views(detections):
    actual = compare_methods(ring(VIEWS), detections, list(METHODS), timed=False)
    assert [row.method for row in actual.methods] == list(METHODS)
    assert actual.noise.origin == "estimated"
    assert {row.method: row.min_views for row in actual.methods}["consensus"] == 2
    asked = Options(triangulation=TriangulationOptions(min_views=4))
    actual = compare_methods(ring(VIEWS), detections, ["consensus", "simple"], asked, timed=False)
    assert [row.min_views for row in actual.methods] == [4, 4]


def test_notes_are_not_repeated(detections):
    rig = ring(VIEWS).select(["cam_0", "cam_1", "cam_2"])
    actual = compare_methods(rig, detections.views(list(rig.names)), list(METHODS), FIXED, timed=False)
    assert len(set(actual.notes)) == len(actual.notes)
    assert sum("drops no camera" in remark for remark in actual.notes) == 1


def test_method_without_points_does_not_stop_the_comparison(points, detections):
    truth = truth_of(ring(VIEWS), skeleton_of(POINTS), points, 60.0)
    pixels = np.array(detections.dense()[0])
    pixels[:, 2:] = np.nan
    two = Detections.from_dense(skeleton_of(POINTS), detections.view_names, pixels, rate_hz=60.0)
    actual = compare_methods(
        ring(VIEWS), two, ["irls", "simple"], FIXED, truth_of=lambda result: truth_from_result(result, truth)
    )
    irls, simple = actual.methods
    assert irls.missing_share < 0.1
    assert simple.missing_share == 1
    assert np.isnan([simple.used_error.median_px, simple.mean_views_used, simple.truth_median_mm]).all()
    assert np.isinf(simple.all_error.median_px)


def test_one_camera_is_refused(detections):
    one = ring(VIEWS).select(["cam_0"])
    with pytest.raises(DetectionsError, match="one camera"):
        compare_methods(one, detections.views(["cam_0"]), ["simple"], FIXED)


def test_spread_matches_hand_computed_values():
    actual = spread_of(np.array([3.0, 1.0, np.inf, 2.0]))
    assert (actual.median_px, actual.p95_px) == (2.0, np.inf)
    assert actual.at_shares_px[0] == 1.0
    assert actual.at_shares_px[300] == 3.0
    assert actual.at_shares_px[301] == np.inf
    assert np.isnan(spread_of(np.array([])).median_px)


class TestAcceleration:
    def test_acceleration_of_a_parabola(self):
        time_s = np.arange(10) / 50
        points = np.zeros((10, 1, 3))
        points[:, 0, 2] = 0.5 * -9.81 * time_s**2
        assert acceleration_m_s2(truth_of(ring(2), skeleton_of(1), points, 50.0)) == pytest.approx(9.81)

    def test_acceleration_needs_a_rate_and_consecutive_frames(self):
        points = np.zeros((4, 1, 3))
        points[2:, 0, 0] = 1.0
        result = truth_of(ring(2), skeleton_of(1), points, 50.0)
        apart = replace(result, frame_numbers=np.array([0, 1, 7, 8]))
        assert np.isnan(acceleration_m_s2(apart))
        assert acceleration_m_s2(replace(result, rate_hz=None)) is None


def test_numbers_of_a_single_result(detections):
    result = reconstruct(ring(VIEWS), detections, FIXED)
    row = method_numbers(result, None, 0.002)
    assert (row.method, row.min_views, row.cpu_ms_per_frame) == ("consensus", 2, 2.0)


def test_truth_of_several_people():
    """Of three people one is not found, and one is 20 mm off."""
    scene = simulate_walkers(people=3)
    actual = track_perfectly(scene)
    measured = scene.truth.layers["measured"]
    points = np.array(measured.points_m)
    reference = people_points(actual, replace(scene.truth, layers={"measured": replace(measured, points_m=points)}))
    numbers = method_numbers(replace(actual, resolved=with_two_views(actual.options)), reference, None)
    assert numbers.truth_median_mm == pytest.approx(np.sqrt(3) * 8.9, rel=0.15)
    shifted = replace(reference, points_m=reference.points_m + 0.1)
    errors = matched_errors_mm(shifted)
    assert np.nanmedian(errors) == pytest.approx(173.0, rel=0.05)


def with_two_views(options: Options) -> Options:
    return replace(options, triangulation=TriangulationOptions(min_views=2))
