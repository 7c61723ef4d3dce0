"""The report: one page, no network, the same bytes, hostile names harmless."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from posefuse.evaluation.accuracy import evaluate, truth_from_result
from posefuse.model.reconstruction import Provenance
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.model.track_events import Event
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.report import html
from posefuse.report import scene as scene_module
from posefuse.report.charts import keypoint_groups
from posefuse.report.html import render_report
from posefuse.report.summary_text import scene_in_words
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.scenes import body_points, ring, seen


@pytest.fixture(scope="module")
def scene():
    return simulate(SceneOptions(duration_s=2, cameras=4, lens="fisheye"))


@pytest.fixture(scope="module")
def result(scene):
    return reconstruct(scene.rig, scene.detections)


def data_of(page: str) -> dict:
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found
    return json.loads(found.group(1))


def test_it_needs_no_network(result):
    page = render_report(result)
    outside = page.replace(html.get_plotlyjs(), "")
    assert not re.search(r"(src|href)\s*=", outside)
    assert "http" not in outside
    assert len(page) < 15e6


def test_the_same_bytes_for_the_same_result(result):
    assert render_report(result) == render_report(result)


def test_it_says_what_came_out_in_words(scene, result):
    accuracy = evaluate(result, truth_from_result(result, scene.truth))
    page = render_report(result, scene.truth, accuracy)
    for words in ("1 person, 26 keypoints (halpe_26), 60 frames (2.0 s at 30 Hz), 4 cameras", "method consensus",
                  "Against the truth: median error", "Inside their 68 / 95 % region", "cam_3"):  # fmt: skip
        assert words in page


def test_the_scene_holds_every_point(scene, result):
    import base64

    shown = data_of(render_report(result, scene.truth))["scene"]
    assert {layer["name"] for layer in shown["layers"]} == set(result.layers)
    assert shown["layers"][0]["name"] == result.best_layer()[0]
    steps = np.frombuffer(base64.b64decode(shown["layers"][0]["points"][0]), "<i2").reshape(60, 26, 3)
    points = np.array(shown["middle"]) + shown["step"] * np.where(steps == -32768, np.nan, steps)
    assert shown["step"] < 1e-3
    np.testing.assert_allclose(points, np.array(result.best_layer()[1].points_m)[:, 0], rtol=0, atol=shown["step"])
    assert shown["truth"]
    assert len(shown["cameras"]) == 4
    np.testing.assert_allclose(shown["cameras"][1]["centre"], scene.rig.cameras[1].centre_m, atol=1e-4)
    assert set(shown["sides"]) == {"left", "right", "middle"}


def test_long_recordings_are_thinned_and_said_to_be(monkeypatch, result):
    monkeypatch.setattr(scene_module, "SHOWN_FRAMES", 7)
    page = render_report(result)
    assert data_of(page)["scene"]["frames"] == list(range(0, 60, 9))
    assert "every 9th frame" in page


def test_large_scenes_are_thinned(monkeypatch, result):
    monkeypatch.setattr(scene_module, "SHOWN_BYTES", 30_000)
    assert scene_module.stride_of(result) > 1
    assert len(json.dumps(data_of(render_report(result))["scene"]["layers"])) < 30_000


@pytest.mark.parametrize(("stride", "words"), [(2, "2nd"), (3, "3rd"), (12, "12th"), (21, "21st")])
def test_ordinals(stride, words):
    assert f"every {words} frame" in scene_in_words(stride, 0)


def test_strays_are_left_out_and_counted(result):
    name, layer = result.best_layer()
    points = np.array(layer.points_m)
    points[5, 0, 3] = 1e5
    page = render_report(replace(result, layers={name: replace(layer, points_m=points)}))
    assert "1 points so far out" in page
    assert data_of(page)["scene"]["step"] < 1e-3


def test_ranges_make_no_difference(monkeypatch, result):
    monkeypatch.setattr(scene_module, "SHOWN_FRAMES", 7)
    whole = render_report(result)
    usual = type(result).windows
    monkeypatch.setattr(type(result), "windows", lambda self, size=10: usual(self, 10))
    assert render_report(result) == whole


def test_findings_of_the_health_check_come_first(result):
    notes = ("Read.", "Recording check: Camera <b>3</b> is turned. (90 % certain) Refit it.")
    page = render_report(replace(result, provenance=Provenance(notes=notes)))
    assert "<ol><li>Camera &lt;b&gt;3&lt;/b&gt; is turned." in page
    assert "Findings of the health check" not in render_report(result)


def test_names_from_files_cannot_run(result):
    hostile = '</script><img src=x onerror="alert(1)">'
    cameras = (replace(result.rig.cameras[0], name=hostile), *result.rig.cameras[1:])
    page = render_report(
        replace(result, rig=replace(result.rig, cameras=cameras), provenance=Provenance(notes=(hostile,)))
    )
    assert hostile not in page
    assert "<img" not in page.replace(html.get_plotlyjs(), "")
    assert data_of(page)["charts"]["views"][0] == hostile


def test_one_camera_is_said_to_be_no_world(rng):
    rig = ring(1)
    page = render_report(reconstruct(rig, seen(rig, body_points(rng, 3), rng)))
    assert "its image plane in pixels" in page
    assert data_of(page)["scene"]["cameras"] == []


def test_an_unknown_up_is_said(result):
    page = render_report(replace(result, rig=replace(result.rig, up_axis=None)))
    assert "Which way is up is unknown" in page


def test_missing_points_are_counted_and_explained(rng):
    rig = ring(3)
    detections = seen(rig, body_points(rng, 4), rng)
    keypoints = np.array(detections.keypoints_px)
    keypoints[:, 3] = np.nan
    page = render_report(reconstruct(rig, replace(detections, keypoints_px=keypoints)))
    assert "4 points are missing: no valid detection." in page


def test_keypoints_are_grouped_each_in_one_group():
    for name in ("coco_wholebody_133", "body_20", "mouse_22"):
        skeleton = shipped_skeleton(name)
        groups = keypoint_groups(skeleton)
        assert sorted(k for _, places in groups for k in places) == list(range(len(skeleton)))
        assert [group for group, _ in groups] == (
            ["body", "left hand", "right hand", "face"] if name == "coco_wholebody_133" else ["body"]
        )


def test_what_stands_out_is_named_with_its_worst_frame(result):
    name, layer = result.best_layer()
    errors, statuses = np.array(layer.view_error_px), np.array(layer.view_status)
    errors[..., 2] *= 3.0
    errors[7, 0, 5, 2] = 999.0
    statuses[7, 0, 5, 2] = ViewStatus.USED
    page = render_report(replace(result, layers={name: replace(layer, view_error_px=errors, view_status=statuses)}))
    look = page.split('id="look"')[1].split("</section>")[0]
    assert "Camera cam_2 errs more than the others" in look
    assert 'data-place="7" data-person="0" data-keypoint="5" data-view="2"' in look
    assert "Camera cam_1 errs" not in look


def test_nothing_to_see_is_explained(result):
    name, layer = result.best_layer()
    status = np.full(layer.status.shape, PointStatus.TOO_FEW_VIEWS, dtype=np.int8)
    points = np.full(layer.points_m.shape, np.nan)
    page = render_report(replace(result, layers={name: replace(layer, status=status, points_m=points)}))
    assert "No point has coordinates, most for one reason: fewer valid views than min_views." in page


def test_a_camera_that_went_wrong_is_named(result):
    name, layer = result.best_layer()
    statuses = np.array(layer.view_status)
    statuses[:40, ..., 3] = ViewStatus.UNSEEN
    event = Event(40, 40 / 30, "cam_3", "camera refused", "it shows < 15% of the people")
    page = render_report(replace(result, layers={name: replace(layer, view_status=statuses)}, events=(event,)))
    look = page.split('id="look"')[1].split("</section>")[0]
    assert "cam_3: camera refused, it shows &lt; 15% of the people. <button" in look
    assert re.search(r"Camera cam_3 counts in 3\d % of the points", look)
    assert "Camera cam_1 counts" not in look
