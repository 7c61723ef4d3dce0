"""The page of a batch in a browser: nothing is outside a window of common width."""

import pytest

from posefuse.model.batch import JobResult, ResultStatistics
from posefuse.report.batch import batch_page

STATISTICS = ResultStatistics(267, 8.8, 4, 1, 0.879, 8.69, 28.88, 13.3)
WARNING = (
    "The cameras have no common trigger. Time offsets of the views, in frames: 'cam_1' +1.19 +- 0.12, 'cam_3' +1.35 "
    "+- 0.06. (99 % certain) Measure the time offsets with `posefuse.measure_sync`, and correct them with `sync`."
)
RESULTS = (
    JobResult("webcams", "done", "", STATISTICS, (WARNING,)),
    JobResult("a_long_name_of_a_recording_" * 4, "done", "", STATISTICS),
    JobResult("notes.txt", "failed", "notes.txt is neither a calibration nor keypoints in a known format. " * 3),
)


@pytest.fixture
def page(browser, tmp_path):
    path = tmp_path / "batch.html"
    path.write_text(batch_page(RESULTS), "utf-8")
    opened = browser.new_page(viewport={"width": 1400, "height": 900})
    opened.goto(path.as_uri())
    yield opened
    opened.close()


@pytest.mark.parametrize("width", [1400, 800])
def test_all_columns_are_visible(page, width):
    page.set_viewport_size({"width": width, "height": 900})
    last = page.locator("table.batch th").last.bounding_box()
    assert last["x"] + last["width"] <= width
    assert page.evaluate("document.querySelector('.wide').scrollWidth <= document.querySelector('.wide').clientWidth")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    warning = page.locator(".warning div").bounding_box()
    assert warning["x"] + warning["width"] <= width


def test_warnings_of_wide_tables_fit_a_phone(page):
    page.set_viewport_size({"width": 390, "height": 800})
    warning = page.locator(".warning div").bounding_box()
    assert warning["x"] + warning["width"] <= 390


def test_names_are_not_broken_without_need(page):
    name = page.locator(".reasons dt")
    lines = name.evaluate(
        """(each) => { const range = document.createRange();
        range.selectNodeContents(each);
        return range.getClientRects().length; }"""
    )
    assert lines == 1
