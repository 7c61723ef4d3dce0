"""The report page in a browser: loading, playback, navigation, printing."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from posefuse.pipeline import report_videos
from posefuse.pipeline.gait import analyze_gait
from posefuse.pipeline.joint_angles import with_joint_angles
from posefuse.pipeline.report_videos import write_report
from posefuse.report.html import render_report
from posefuse.synthetic.gait_plans import WalkPlan, walk
from posefuse.synthetic.gait_scenes import simulate_gait
from tests.people import simulate_walkers, track_perfectly
from tests.videos import coded_video, moving_sticks

CHARTS_DRAWN = "document.querySelector('#keypoint-errors .js-plotly-plot')"
HOSTILE = '<img src=x onerror="window.ran=1">'


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Report of two people with names that contain HTML."""
    result = track_perfectly(simulate_walkers(people=2, seconds=4.0))
    first, *others = result.rig.cameras
    rig = replace(result.rig, cameras=(replace(first, name=HOSTILE), *others))
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(render_report(replace(result, rig=rig)), "utf-8")
    return path


def is_problem(message) -> bool:
    """Return whether a message of the console is an error or a warning, apart from a remark of software drivers."""
    return message.type in ("error", "warning") and "GL Driver Message" not in message.text


@pytest.fixture(scope="module")
def opened(browser, file):
    """The page and a list of its problems: errors, warnings, network requests."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    problems: list[str] = []
    page.on("console", lambda message: problems.append(message.text) if is_problem(message) else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda request: problems.append(request.url) if not request.url.startswith("file:") else None)
    page.goto(file.as_uri())
    page.wait_for_function("document.querySelector('#gaps .cursor') && document.querySelector('#canvas').width > 300")
    return page, problems


@pytest.fixture
def page(opened):
    """The page at its first frame in the free view."""
    page, _ = opened
    page.select_option("#view", "-1")
    page.locator("#canvas").focus()
    page.keyboard.press("Home")
    canvas_hash(page)
    return page


def canvas_hash(page) -> int:
    """Return a hash of the canvas after the next frame is drawn."""
    text = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(canvas.toDataURL()))))"
    return hash(page.evaluate(text))


def frame_of(page) -> int:
    return int(page.get_attribute("#scene", "data-frame"))


def test_page_loads_without_errors_and_runs_no_injected_script(opened):
    page, problems = opened
    canvas_hash(page)
    assert problems == []
    assert page.evaluate("window.ran") is None
    assert page.locator("#heat thead th").nth(1).inner_text() == HOSTILE


def test_scrubbing_changes_the_frame(page):
    before = canvas_hash(page)
    page.evaluate("scrub.value = 30; scrub.dispatchEvent(new Event('input'))")
    assert frame_of(page) == 30
    assert canvas_hash(page) != before


def test_space_bar_plays_and_pauses(page):
    before, first = canvas_hash(page), frame_of(page)
    page.keyboard.press("Space")
    page.wait_for_function(f"Number(document.getElementById('scene').dataset.frame) != {first}", timeout=10_000)
    page.keyboard.press("Space")
    assert canvas_hash(page) != before
    at = frame_of(page)
    page.wait_for_timeout(200)
    assert frame_of(page) == at


def test_keys_step_rotate_and_select_cameras(page):
    page.keyboard.press("ArrowRight")
    assert frame_of(page) == 1
    page.keyboard.press("Shift+ArrowRight")
    assert frame_of(page) == 26
    images = [canvas_hash(page)]
    for key in ("d", "u", "b", "c"):
        page.keyboard.press(key)
        images.append(canvas_hash(page))
    assert len(set(images)) == len(images)
    assert page.locator("#view").input_value() == "0"
    page.keyboard.press("u")
    page.keyboard.press("b")


@pytest.mark.parametrize("quantity", ["error", "missing"])
def test_cell_jumps_to_its_worst_frame_and_escape_returns(page, quantity):
    page.select_option("#quantity", quantity)
    cell = page.locator("#heat td[data-keypoint='3'][data-view='2']")
    cell.click()
    label = page.locator("#worst button").first.inner_text()
    assert f"frame {frame_of(page)}," in label
    assert page.locator("#view").input_value() == "2"
    page.keyboard.press("Escape")
    assert page.evaluate("document.activeElement.dataset.keypoint") == "3"
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    assert f"frame {frame_of(page)}," in page.locator("#worst button").first.inner_text()


def test_camera_view_matches_the_projection(page, file):
    result = track_perfectly(simulate_walkers(people=2, seconds=4.0))
    camera = result.rig.cameras[1]
    points = np.asarray(result.layers["model"].points_m)[10, 0]
    page.select_option("#view", "1")
    page.evaluate("scrub.value = 10; scrub.dispatchEvent(new Event('input'))")
    canvas_hash(page)
    k = 4
    x, y = camera.project(points[k])[0]
    box = page.locator("#canvas").bounding_box()
    scale = 0.94 * min(box["width"] / camera.size_px[0], box["height"] / camera.size_px[1])
    at_x = box["x"] + (box["width"] - scale * camera.size_px[0]) / 2 + scale * (x + 0.5)
    at_y = box["y"] + (box["height"] - scale * camera.size_px[1]) / 2 + scale * (y + 0.5)
    page.mouse.move(at_x, at_y)
    tip = page.locator("#tooltip").inner_text()
    shown = [float(text) for text in re.findall(r"-?\d+\.\d+", tip)]
    actual = np.abs(points - np.array(shown)).max(axis=-1)
    assert "person_1" in tip
    pixels = camera.project(points[int(np.argmin(actual))])[0]
    assert actual.min() < 2e-3
    assert scale * np.linalg.norm(pixels - (x, y)) < 1.0


def test_print_style_shows_tables_and_hides_controls(page):
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.locator("table.numbers").is_visible()
    assert page.locator("#heat").is_visible()
    assert not page.locator("#controls").is_visible()
    page.emulate_media(media="screen")
    page.evaluate("dispatchEvent(new Event('afterprint'))")


def test_page_counts_as_loading_until_its_charts_are_drawn(browser, file):
    """Captures of a page that has just loaded are complete."""
    fresh = browser.new_page(viewport={"width": 1280, "height": 900})
    fresh.add_init_script(
        """addEventListener("load", () => {
          const drawn = document.querySelectorAll(".js-plotly-plot").length;
          window.atLoad = { drawn, empty: document.querySelectorAll(".chart:empty, .multiples:empty").length };
        });"""
    )
    fresh.goto(file.as_uri())
    at_load = fresh.evaluate("window.atLoad")
    assert at_load["empty"] == 0
    assert at_load["drawn"] == fresh.locator(".js-plotly-plot").count() >= 6
    assert fresh.locator("iframe").count() == 0
    fresh.close()


OVERLAPS = """() => {
  const drawn = document.querySelectorAll("#movement .svg-container > .main-svg:first-child");
  const boxes = [...drawn].map((each) => each.getBoundingClientRect());
  const meet = (a, b) => a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1;
  return [boxes.length, boxes.filter((a, i) => boxes.slice(0, i).some((b) => meet(a, b))).length];
}"""


@pytest.mark.parametrize("event", ["media", "beforeprint"])
def test_printed_charts_of_movement_do_not_overlap(browser, tmp_path, event):
    result = with_joint_angles(simulate_gait(walk(WalkPlan()), WalkPlan().duration_s).truth)
    analysis = analyze_gait(result)
    assert analysis is not None
    path = tmp_path / "report.html"
    path.write_text(render_report(result, gait=analysis.people), "utf-8")
    page = browser.new_page(viewport={"width": 1400, "height": 900})
    page.goto(path.as_uri())
    on_screen = page.evaluate(OVERLAPS)
    if event == "beforeprint":
        page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    page.wait_for_function("document.querySelector('#angles .main-svg').clientWidth < 140")
    charts, overlapping = page.evaluate(OVERLAPS)
    assert overlapping == 0
    assert charts > 12
    assert page.locator("#cycle-numbers").inner_text()
    page.emulate_media(media="screen")
    page.wait_for_function("document.querySelector('#angles .main-svg').clientWidth > 200")
    assert page.evaluate(OVERLAPS) == on_screen
    page.close()


def test_narrow_dark_screen_needs_no_horizontal_scrolling(page):
    light = canvas_hash(page)
    page.emulate_media(color_scheme="dark")
    page.set_viewport_size({"width": 390, "height": 800})
    page.wait_for_function("document.documentElement.scrollWidth <= 390", timeout=10_000)
    assert canvas_hash(page) != light
    page.set_viewport_size({"width": 1280, "height": 900})
    page.emulate_media(color_scheme="light")


def test_chart_clicks_show_frames(page):
    page.evaluate("document.getElementById('time-error').emit('plotly_click', {points: [{x: 2.0}]})")
    assert frame_of(page) == 50


def test_view_follows_a_person(page):
    page.evaluate("scrub.value = 20; scrub.dispatchEvent(new Event('input'))")
    before = canvas_hash(page)
    page.locator("#canvas").focus()
    page.keyboard.press("f")
    assert page.locator("#follow").input_value() == "0"
    assert canvas_hash(page) != before
    page.select_option("#follow", "-1")


@pytest.fixture(scope="module")
def filmed(browser, tmp_path_factory):
    """The report of two people with a video of every camera; the gray of an image states its number."""
    folder = tmp_path_factory.mktemp("filmed")
    videos = {f"cam{i}": coded_video(folder / f"cam{i}.mp4") for i in range(2)}
    (path,) = write_report(moving_sticks(), folder / "report.html", videos=videos)
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.goto(path.as_uri())
    page.wait_for_function("video.readyState >= 2")
    page.wait_for_function(CHARTS_DRAWN, timeout=60_000)
    yield page
    page.close()


def image_number(page) -> int:
    """Return the number that the gray of the shown image states."""
    gray = page.evaluate(
        """() => { const c = document.createElement("canvas"), ink = c.getContext("2d"); c.width = c.height = 3;
        ink.drawImage(video, 0, 0, 3, 3); return ink.getImageData(1, 1, 1, 1).data[1]; }"""
    )
    return round((gray - 20) / 10)


@pytest.mark.parametrize("frame", [0, 3, 10, 7])
def test_video_shows_the_image_of_the_frame_with_its_skeleton(filmed, frame):
    filmed.evaluate(f"scrub.value = {frame}; scrub.dispatchEvent(new Event('input'))")
    filmed.wait_for_function(f"!video.seeking && document.getElementById('video-canvas').dataset.frame === '{frame}'")
    filmed.wait_for_timeout(100)
    assert image_number(filmed) == frame
    result = moving_sticks()
    x, y = result.rig.cameras[0].project(np.asarray(result.layers["measured"].points_m)[frame, 0, 1])[0]
    width, height = result.rig.cameras[0].size_px
    drawn = filmed.evaluate(
        """([x, y]) => { const sheet = document.getElementById("video-canvas"), ink = sheet.getContext("2d");
        return [...ink.getImageData(Math.round(x * sheet.width), Math.round(y * sheet.height), 1, 1).data]; }""",
        [(float(x) + 0.5) / width, (float(y) + 0.5) / height],
    )
    assert drawn[3] > 200


def test_video_follows_playback_and_the_selected_camera(filmed):
    filmed.keyboard.press("Home")
    filmed.click("#play")
    filmed.wait_for_function("!video.paused && video.currentTime > 0.1", timeout=10_000)
    filmed.click("#play")
    filmed.wait_for_function("video.paused && !video.seeking", timeout=10_000)
    filmed.wait_for_timeout(100)
    assert image_number(filmed) == frame_of(filmed)
    filmed.select_option("#view", "1")
    assert filmed.locator("#film-cameras button").nth(1).get_attribute("aria-pressed") == "true"
    filmed.wait_for_function("video.readyState >= 2")
    filmed.select_option("#view", "-1")


def test_linked_videos_play_from_the_folder_beside_the_page(browser, tmp_path, monkeypatch):
    monkeypatch.setattr(report_videos, "EMBEDDED_BYTES", 100)
    videos = {f"cam{i}": coded_video(tmp_path / f"cam{i}.mp4") for i in range(2)}
    path, *linked = write_report(moving_sticks(), tmp_path / "page" / "report.html", videos=videos)
    assert len(linked) == 2
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    problems: list[str] = []
    page.on("console", lambda message: problems.append(message.text) if is_problem(message) else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.goto(path.as_uri())
    page.wait_for_function("video.readyState >= 2", timeout=10_000)
    page.wait_for_function(CHARTS_DRAWN, timeout=60_000)
    assert page.evaluate("video.currentSrc") == linked[0].as_uri()
    page.click("#play")
    page.wait_for_function("!video.paused && video.currentTime > 0.1", timeout=10_000)
    page.click("#play")
    page.wait_for_function("video.paused && !video.seeking", timeout=10_000)
    page.wait_for_timeout(100)
    # A page without a server may not read the pixels of a video, but its picture can be taken.
    picture = cv2.imdecode(np.frombuffer(page.locator("#video").screenshot(), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    shown = round((float(picture[picture.shape[0] // 20, picture.shape[1] // 2]) - 20) / 10)
    assert shown == frame_of(page)
    assert problems == []
    page.close()


def test_videos_fit_a_phone(filmed):
    filmed.set_viewport_size({"width": 390, "height": 800})
    filmed.wait_for_function("document.documentElement.scrollWidth <= 390", timeout=10_000)
    box, sheet = (filmed.locator(f"#{name}").bounding_box() for name in ("video", "video-canvas"))
    assert box == sheet
    assert box["width"] / box["height"] == pytest.approx(4 / 3, rel=0.01)
    filmed.set_viewport_size({"width": 1280, "height": 900})


def test_page_states_why_it_shows_no_video(browser, tmp_path):
    video = coded_video(tmp_path / "a.mp4", size_px=(240, 320))
    (path,) = write_report(moving_sticks(), tmp_path / "report.html", videos={"cam0": video})
    page = browser.new_page()
    page.goto(path.as_uri())
    assert "The video of cam0 is not shown" in page.locator("#video-note").inner_text()
    assert not page.locator("#video").is_visible()
    page.close()
