"""The report of a calibration in a browser: loading, drawing, and small screens."""

import pytest

from posefuse.report.calibration.page import render_calibration
from tests.calibration_summaries import board_summary, people_summary, scene_summary


@pytest.fixture(params=[board_summary, people_summary, scene_summary])
def file(request, tmp_path):
    path = tmp_path / "calibration.html"
    path.write_text(render_calibration(request.param()), "utf-8")
    return path


def canvas_of(page) -> str:
    text = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(canvas.toDataURL()))))"
    return page.evaluate(text)


@pytest.mark.parametrize("width", [1280, 390])
def test_page_draws_and_fits_the_screen(browser, file, width):
    page = browser.new_page(viewport={"width": width, "height": 800})
    problems: list[str] = []
    page.on("console", lambda message: problems.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda request: problems.append(request.url) if not request.url.startswith("file:") else None)
    page.goto(file.as_uri())
    page.wait_for_function("document.querySelector('#canvas').width > 300")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    free = canvas_of(page)
    page.check("#show-uncertainty")
    volume = canvas_of(page)
    page.uncheck("#show-uncertainty")
    page.select_option("#view", "1")
    assert len({free, volume, canvas_of(page)}) == 3
    if page.is_visible("#play"):
        page.click("#play")
        page.wait_for_function("document.querySelector('#scrub').value > 2")
    else:
        assert page.evaluate("document.querySelector('#scrub').max") == "0"
    assert problems == []
    page.close()
