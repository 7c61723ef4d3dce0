"""Points of known position in the report of a calibration."""

import numpy as np

from posefuse.report.calibration.page import render_calibration
from posefuse.report.calibration.points import points_section, worst_sds
from tests.calibration_summaries import board_summary, scene_summary
from tests.unit.report.calibration.test_page import text_of


def test_worst_point_comes_first_and_is_marked():
    summary = scene_summary(wrong=4)
    assert summary.known_points is not None
    assert np.argmax(worst_sds(summary.known_points)) == 4
    section = points_section(summary)
    assert section.index("<th>5</th>") < section.index("<th>1</th>")
    assert section.count('class="wrong"') == 1


def test_page_of_points_has_neither_frames_nor_a_reference():
    text = text_of(render_calibration(scene_summary(wrong=4)))
    assert "27 places in 3 images" in text
    assert "in the world of the points" in text
    assert "Frames that cameras share" not in text
    assert "reference" not in text
    assert "board" not in text.lower()


def test_every_place_is_drawn():
    page = render_calibration(scene_summary())
    assert page.count("<g><title>point ") == 27


def test_boards_have_no_such_section():
    assert points_section(board_summary()) == ""
