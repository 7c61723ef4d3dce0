"""The verdict on a calibration and what to film next."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.assessment import assess
from posefuse.model.calibration_summary import LengthCheck
from tests.calibration_summaries import board_summary, people_summary, with_camera


def volume(summary, **changes):
    return replace(summary, volume=replace(summary.volume, **changes))


def test_good_calibration_has_no_advice():
    found = assess(board_summary())
    assert found.level == "good"
    assert found.advice == ()
    assert "relative to each other" in found.sentence


def structured(summary):
    """A lens whose error grows from the center of the image."""
    pixels = summary.cameras[1].pixels
    return with_camera(summary, 1, residual_px=0.01 * (pixels - pixels.mean(axis=0)))


@pytest.mark.parametrize(
    ("change", "level", "sentence", "remedy"),
    [
        (lambda s: volume(s, relative_sd_m=0.008), "check", "only to 8 mm", "Film the board for longer"),
        (lambda s: volume(s, relative_sd_m=0.05), "bad", "only to 50 mm", "Film the board for longer"),
        (lambda s: volume(s, relative_sd_m=np.nan), "bad", "No two cameras", "Film the board"),
        (lambda s: replace(s, lengths=(LengthCheck("lengths", 0.01, 0.0, 9),)), "check", "+1 % off", "Measure"),
        (lambda s: replace(s, lengths=(LengthCheck("lengths", -0.1, 0.0, 9),)), "bad", "-10 % off", "Measure"),
        (lambda s: with_camera(s, 2, center_sd_m=0.1), "check", "'cam_2' is known only to 100 mm", "Film the board"),
        (lambda s: replace(s, shared=np.full((3, 3), 4)), "check", "'cam_0' shares only 4 frames", "Film the board"),
        (
            lambda s: with_camera(s, 1, residual_px=4 * s.cameras[1].residual_px),
            "check",
            "fits worse than the others: root mean",
            "motion blur",
        ),
        (structured, "check", "depend on the place in the image", "refine_intrinsics"),
        (lambda s: with_camera(s, 0, held_out_px=2.0), "check", "only to 2.00 px", "more images"),
        (lambda s: with_camera(s, 1, offset_s=-0.12, offset_sd_s=0.005), "good", "'cam_1' -120 ms", "posefuse sync"),
        (lambda s: replace(s, left_out=(("cam_9", "no overlap."),)), "check", "'cam_9' is not calibrated", ""),
    ],
)
def test_weaknesses_are_named_with_a_remedy(change, level, sentence, remedy):
    found = assess(change(board_summary()))
    assert found.level == level
    assert any(sentence in each.sentence and remedy in each.remedy for each in found.advice)
    if level == "bad":
        assert found.advice[0].level == "bad"
        assert found.sentence.startswith("Do not use")


def test_missing_regions_matter_for_estimated_lenses_only():
    summary = board_summary()
    few = np.flatnonzero(summary.cameras[1].pixels[:, 0] < 0.6 * 1280)
    part = {name: getattr(summary.cameras[1], name)[few] for name in ("pixels", "residual_px", "image")}
    assert not any("board only in" in str(each) for each in assess(with_camera(summary, 1, **part)).advice)
    found = assess(with_camera(summary, 1, lens_given=False, **part))
    assert any("board only in the" in each.sentence and "middle center" in each.sentence for each in found.advice)


def test_people_are_not_called_a_board():
    found = assess(people_summary())
    assert not any("board" in str(each) for each in found.advice)
    assert "5 %" in found.sentence


@pytest.mark.parametrize(("path_m", "stays"), [(0.2, True), (3.0, False)])
def test_people_who_stay_in_one_place_are_named(path_m, stays):
    rng = np.random.default_rng(0)
    body = rng.uniform(-0.5, 0.5, (17, 3)) * (0.5, 0.5, 1.8)
    places = np.linspace(0.0, path_m, 40)[:, None] * (1.0, 0.0, 0.0)
    points_m = (body + places[:, None])[:, None] + 0.01 * rng.normal(size=(40, 1, 17, 3))
    points_m[3] = np.nan
    found = assess(replace(people_summary(), points_m=points_m)).advice
    assert any("stay in one place" in each.sentence for each in found) == stays


def test_a_board_that_stays_in_one_place_is_not_a_person():
    summary = board_summary()
    still = replace(summary, points_m=summary.points_m[:1].repeat(10, axis=0))
    assert not any("stay in one place" in each.sentence for each in assess(still).advice)
