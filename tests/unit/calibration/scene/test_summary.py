"""Summary of a calibration by points of known position, and its assessment."""

import numpy as np

from posefuse.calibration.assessment import assess
from tests.calibration_summaries import scene_summary


def test_summary_agrees_with_the_calibration():
    summary = scene_summary()
    assert summary.n_observations == 27
    assert 0.3 < summary.error_px < 1.2
    assert all(each.held_out_px > each.error_px for each in summary.cameras)
    assert summary.volume.n_views.min() >= 2
    assert 0.0 < summary.volume.relative_sd_m < 0.01
    assert summary.shared.tolist() == np.full((3, 3), 9).tolist()


def test_good_points_have_no_weakness():
    assessment = assess(scene_summary())
    assert assessment.level == "good"
    assert assessment.advice == ()


def test_wrong_place_is_named_with_its_image():
    (advice,) = assess(scene_summary(wrong=4)).advice
    assert (advice.level, advice.camera) == ("check", "cam_1")
    assert "Point 5 " in advice.sentence
    assert "its place in that image" in advice.remedy


def test_wrong_position_is_named_as_such():
    (advice,) = assess(scene_summary(wrong=4, views=(0, 1, 2))).advice
    assert "Point 5 " in advice.sentence
    assert "its position again" in advice.remedy


def test_few_points_are_stated():
    sentences = [str(each) for each in assess(scene_summary(n_points=5)).advice]
    assert sum("shows only 5 points" in each for each in sentences) == 3
