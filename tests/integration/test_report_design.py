"""The report page in a browser: accessibility, bodies, timeline, theme, and a browser without WebGL."""

import re
from dataclasses import replace

import numpy as np
import pytest

from posefuse.report.html import render_report
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.people import simulate_walkers, track_perfectly

_NO_WEBGL = """const usual = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return kind.startsWith("webgl") ? null : usual.call(this, kind, ...more);
};"""


def truth_of(skeleton: str):
    return simulate(SceneOptions(duration_s=0.5, cameras=3, skeleton=skeleton)).truth


RESULTS = {
    "one person": lambda: truth_of("halpe_26"),
    "four people": lambda: track_perfectly(simulate_walkers(people=4, seconds=0.5)),
    "mouse": lambda: truth_of("mouse_22"),
    "133 keypoints": lambda: truth_of("coco_wholebody_133"),
}


def open_page(browser, folder, result, init: str = ""):
    """Open a report and wait until everything is drawn; problems of the console are in its attribute ``problems``."""
    path = folder / "report.html"
    path.write_text(render_report(result, recording="walk"), "utf-8")
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    if init:
        page.add_init_script(init)
    page.problems = []
    page.on("pageerror", lambda error: page.problems.append(str(error)))
    # Software drivers report that they read pixels back.
    page.on(
        "console", lambda message: "GL Driver" in message.text or page.problems.append(f"{message.type} {message.text}")
    )
    page.goto(path.as_uri())
    page.wait_for_function("document.querySelector('#keypoint-errors .js-plotly-plot')", timeout=60_000)
    return page


@pytest.mark.parametrize("name", RESULTS)
def test_axe_finds_no_violation(browser, tmp_path, name):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    page = open_page(browser, tmp_path, RESULTS[name]())
    found = axe.Axe().run(page).response["violations"]
    # The other theme differs in its colors only.
    page.click("#theme")
    found += axe.Axe().run(page, options={"runOnly": ["color-contrast"]}).response["violations"]
    assert [(each["id"], [node["target"] for node in each["nodes"]]) for each in found] == []
    assert page.problems == []
    page.close()


@pytest.fixture(scope="module")
def walkers():
    return track_perfectly(simulate_walkers(people=2, seconds=2.0))


@pytest.fixture(scope="module")
def page(browser, tmp_path_factory, walkers):
    opened = open_page(browser, tmp_path_factory.mktemp("design"), walkers)
    yield opened
    opened.close()


def test_head_states_recording_and_verdict(page):
    assert page.locator("h1").inner_text() == "walk"
    assert page.title() == "walk"
    facts = page.locator("#facts").inner_text()
    assert re.search(r"2\.0 s.*25 Hz.*cameras.*2 people", facts, re.DOTALL)
    assert page.locator("#verdict .badge").is_visible()


def test_bodies_are_drawn_below_the_canvas(page):
    share = page.evaluate(
        """() => { const small = document.createElement("canvas"), ink = small.getContext("2d");
        small.width = small.height = 60;
        ink.drawImage(document.getElementById("solids"), 0, 0, 60, 60);
        const { data } = ink.getImageData(0, 0, 60, 60);
        let n = 0;
        for (let i = 3; i < data.length; i += 4) n += data[i] > 250;
        return n / 3600; }"""
    )
    assert 0.002 < share < 0.9
    assert page.locator("#no-solids").is_hidden()


def test_timeline_has_rows_and_seeks(page):
    names = page.locator(".strip > span").all_inner_texts()
    assert names[:2] == ["person_1", "person_2"]
    box = page.locator(".strip canvas").first.bounding_box()
    page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + box["height"] / 2)
    assert int(page.get_attribute("#scene", "data-frame")) == pytest.approx(37, abs=1)
    mark = page.locator(".now").bounding_box()
    assert mark["x"] + mark["width"] / 2 == pytest.approx(box["x"] + 0.75 * box["width"], abs=0.02 * box["width"])


def test_switch_changes_the_theme_and_the_charts(page):
    color = "getComputedStyle(document.body).backgroundColor"
    line = "document.getElementById('time-error').data[0].line.color"
    before = page.evaluate(color), page.evaluate(line)
    page.click("#theme")
    after = page.evaluate(color), page.evaluate(line)
    assert before[0] != after[0]
    assert before[1] != after[1]
    page.click("#theme")
    assert (page.evaluate(color), page.evaluate(line)) == before


def test_command_is_copied_or_selected(page):
    page.click("#copy")
    page.wait_for_function("document.getElementById('copy').textContent !== 'Copy'")
    assert "posefuse reconstruct RECORDING" in page.locator("#command").inner_text()


def test_section_links_are_all_visible(page):
    page.set_viewport_size({"width": 1400, "height": 900})
    nav = page.locator("#sections")
    right = nav.evaluate("(each) => Math.max(...[...each.children].map((link) => link.getBoundingClientRect().right))")
    assert right <= 1400
    assert nav.evaluate("(each) => each.scrollWidth <= each.clientWidth")
    assert nav.bounding_box()["height"] < 90
    page.set_viewport_size({"width": 1280, "height": 900})


@pytest.fixture
def whole(browser, tmp_path):
    opened = open_page(browser, tmp_path, RESULTS["133 keypoints"]())
    yield opened
    opened.close()


def test_tables_and_charts_of_133_keypoints_are_folded(whole):
    assert whole.locator("#heat td:visible").count() == 23 * 3
    assert whole.locator("#gaps details").count() == 4
    assert whole.locator("#gaps details[open]").count() == 1
    assert whole.evaluate("document.documentElement.scrollHeight") < 9000
    whole.locator("#heat button.fold").nth(1).click()
    assert whole.locator("#heat td:visible").count() == (23 + 21) * 3
    # The keyboard goes from the body to the opened hand, and past folded parts.
    whole.locator("#heat td[data-keypoint='22'][data-view='1']").click()
    whole.keyboard.press("ArrowDown")
    assert whole.evaluate("document.activeElement.dataset.keypoint") == "91"
    whole.locator("#gaps details summary").nth(3).click()
    whole.wait_for_function("document.querySelectorAll('#gaps .js-plotly-plot .cursor').length === 2")
    assert whole.problems == []


PROBE = "if (nFrames) show(firstFrame);"


def first_view(browser, folder, result):
    """Return the first frame, and the rectangles of people and cameras on the screen with their depths."""
    path = folder / "report.html"
    text = render_report(result)
    assert text.count(PROBE) == 1
    path.write_text(
        text.replace(PROBE, f"{PROBE} window.probe = {{ state, screenBox, freeProjection, layers, K, at }};")
    )
    page = browser.new_page(viewport={"width": 1400, "height": 900})
    page.goto(path.as_uri())
    view = page.evaluate(
        """() => {
          const { state, screenBox, freeProjection, layers, K, at } = probe, canvas = document.getElementById("canvas");
          const to = freeProjection({ x: 0, y: 0, width: canvas.clientWidth, height: canvas.clientHeight });
          const points = (of) => Array.from({ length: K }, (_, k) => at(of, state.frame, k)).filter(Boolean);
          const { cameras } = JSON.parse(document.getElementById("data").textContent).scene;
          return { frame: state.frame, turn: state.turn,
            people: layers[0].points.map((of) => screenBox(points(of), to)),
            cameras: cameras.map(({ center, corners }) => screenBox([center, ...corners], to)) };
        }"""
    )
    page.close()
    return view


def covers(one, other):
    return max(0, min(one["right"], other["right"]) - max(one["left"], other["left"])) * max(
        0, min(one["bottom"], other["bottom"]) - max(one["top"], other["top"])
    )


def test_first_view_shows_complete_people_side_by_side_with_no_camera_before_them(browser, tmp_path, walkers):
    """The second person stands behind the first one as seen from the usual viewpoint, where a camera is, too."""
    behind = -1.2 * np.array([np.cos(0.9), np.sin(0.9), 0.0])
    layers = {}
    for name, layer in walkers.layers.items():
        points = np.array(layer.points_m)
        points[:, 1] = points[:, 0] + behind
        points[:7, 1, :3] = np.nan
        layers[name] = replace(layer, points_m=points)
    view = first_view(browser, tmp_path, replace(walkers, layers=layers))
    assert view == first_view(browser, tmp_path, replace(walkers, layers=layers))
    assert view["frame"] == 7
    one, other = view["people"]
    assert covers(one, other) == 0
    for camera in filter(None, view["cameras"]):
        for person in view["people"]:
            assert camera["depth"] > person["depth"] or covers(camera, person) == 0


@pytest.mark.parametrize("width", [390, 768, 2560])
def test_page_fits_screens_of_all_sizes(page, width):
    page.set_viewport_size({"width": width, "height": 1000})
    page.wait_for_function(f"document.documentElement.scrollWidth <= {width}", timeout=10_000)
    page.set_viewport_size({"width": 1280, "height": 900})


def test_lines_are_drawn_without_webgl(browser, tmp_path, walkers):
    page = open_page(browser, tmp_path, walkers, _NO_WEBGL)
    assert page.locator("#no-solids").is_visible()
    drawn = page.evaluate("canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some((v) => v)")
    assert drawn
    assert page.problems == []
    page.close()
