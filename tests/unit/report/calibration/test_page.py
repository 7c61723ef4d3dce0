"""The report of a calibration as text."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.assessment import assess
from posefuse.report.calibration.page import render_calibration
from tests.calibration_summaries import board_summary, people_summary, with_camera


@pytest.fixture(scope="module")
def page():
    return render_calibration(board_summary())


def text_of(page):
    """The visible words of a page."""
    body = re.sub(r"<(script|style)[^>]*>.*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(re.sub(r"<[^>]*>", " ", body).split())


def test_verdict_and_key_figures_come_first(page):
    summary, text = board_summary(), text_of(page)
    assert assess(summary).sentence in text
    assert f"{summary.error_px:.2f} px root mean square error" in text
    assert text.index("Good") < text.index("What to film") < text.index("Cameras and filmed volume")


def test_every_camera_has_a_row_and_a_drawing(page):
    summary, text = board_summary(), text_of(page)
    for v, each in enumerate(summary.cameras):
        assert f'id="camera-{v}"' in page
        assert f"cam_{v} {each.n_images} {each.error_px:.2f} {each.held_out_px:.2f} brown (given)" in text
    assert page.count('<svg class="image"') == page.count('<svg class="scatter"') == 3


def test_covariance_is_stated_in_millimetres(page):
    volume, shown = board_summary().volume, [float(number) for number in re.findall(r"([\d.]+) mm", text_of(page))]
    for value in (volume.relative_sd_m, volume.middle_sd_m, volume.length_sd):
        assert min(abs(number / (1000 * value) - 1.0) for number in shown) < 0.05


def test_page_loads_nothing(page):
    assert not re.search(r'(src|href)="(?!#)', page)
    assert "http" not in page.replace("http://www.w3.org", "")
    assert len(page) < 400_000


def test_same_calibration_gives_the_same_page(page):
    assert render_calibration(board_summary()) == page


def test_scene_holds_all_poses_of_the_board(page):
    scene = json.loads(re.findall(r'type="application/json">(.*?)</script>', page)[0])["scene"]
    summary = board_summary()
    assert scene["frames"] == summary.frames.tolist()
    assert len(scene["cameras"]) == 3
    assert len(scene["volume"]["points"]) == len(summary.volume.points_m)


def test_people_have_no_board():
    summary = people_summary()
    page = render_calibration(summary)
    text = text_of(page)
    assert "saw the same people" in text
    assert "Camera 'cam_9' is not calibrated" in text.replace("&#x27;", "'")
    assert "board" not in text.lower()
    scene = json.loads(re.findall(r'type="application/json">(.*?)</script>', page)[0])["scene"]
    assert scene["people"] == ["person_1", "person_2"]


def test_held_out_errors_are_shown_if_known():
    summary = board_summary()
    for v in range(3):
        summary = with_camera(summary, v, held_out_px=float("nan"))
    assert "Held-out" not in text_of(render_calibration(summary))
    text = text_of(render_calibration(with_camera(summary, 1, held_out_px=0.31)))
    assert "Held-out" in text
    assert "0.31 px in held-out images" in text


def test_hostile_names_are_text():
    summary = board_summary()
    first, *others = summary.rig.cameras
    rig = replace(summary.rig, cameras=(replace(first, name="<img src=x onerror=alert(1)>"), *others))
    assert "<img" not in render_calibration(replace(summary, rig=rig, shared=np.zeros((3, 3), dtype=np.int64)))
