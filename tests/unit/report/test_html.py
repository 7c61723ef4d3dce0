"""The report page: no network access, reproducible bytes, escaped names."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from posefuse.evaluation.accuracy import evaluate, truth_from_result
from posefuse.model.layer_scores import LayerScore
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Provenance
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.model.track_events import Event
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.report import html
from posefuse.report import scene as scene_module
from posefuse.report.charts import keypoint_groups
from posefuse.report.html import render_report
from posefuse.report.page import asset
from posefuse.report.summary import layer_origin
from posefuse.report.summary_text import scene_note
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.scenes import body_points, ring, simulate_detections


@pytest.fixture(scope="module")
def scene():
    return simulate(SceneOptions(duration_s=2, cameras=4, lens="fisheye"))


@pytest.fixture(scope="module")
def result(scene):
    return reconstruct(scene.rig, scene.detections)


def data_of(page: str) -> dict:
    actual = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert actual
    return json.loads(actual.group(1))


def test_page_needs_no_network(result):
    page = render_report(result)
    outside = page.replace(html.asset(html.PLOTLY), "").replace(asset("three.min.js"), "")
    assert not re.search(r"""(src\s*=|href\s*=\s*["'](?!#))""", outside)
    assert "http" not in outside
    assert len(page) < 15e6


def test_layers_show_how_they_predict_left_out_views(result):
    scores = (LayerScore("measured", 4.66, 6.73, 1.0), LayerScore("solved", 4.5, 6.47, 0.995))
    page = render_report(replace(result, layer_scores=scores))
    rows = re.search(r"<h2>Layers</h2>.*?</table>", page, re.DOTALL)
    assert rows
    assert "<td>solved (default)</td><td>4.50</td><td>6.47</td><td>99.5 %</td>" in rows[0]
    assert "<td>measured</td><td>4.66</td>" in rows[0]
    assert "<h2>Layers</h2>" not in render_report(replace(result, layer_scores=()))


def test_same_result_gives_the_same_bytes(result):
    assert render_report(result) == render_report(result)


def test_summary_states_the_result_in_sentences(scene, result):
    accuracy = evaluate(result, truth_from_result(result, scene.truth))
    page = render_report(result, np.asarray(scene.truth.layers["measured"].points_m), accuracy)
    for words in ("1 person, 26 keypoints (halpe_26), 60 frames (2.0 s at 30 Hz), 4 cameras",
                  "The numbers are those of the layer",
                  "Compared with the ground truth: median error", "Coverage of the 68 / 95 % regions",
                  "cam_3"):  # fmt: skip
        assert words in page


def test_scene_contains_every_point(scene, result):
    import base64

    shown = data_of(render_report(result, np.asarray(scene.truth.layers["measured"].points_m)))["scene"]
    assert {layer["name"] for layer in shown["layers"]} == set(result.layers)
    assert shown["layers"][0]["name"] == result.best_layer()[0]
    steps = np.frombuffer(base64.b64decode(shown["layers"][0]["points"][0]), "<i2").reshape(60, 26, 3)
    points = np.array(shown["origin"]) + shown["step"] * np.where(steps == -32768, np.nan, steps)
    assert shown["step"] < 1e-3
    np.testing.assert_allclose(points, np.array(result.best_layer()[1].points_m)[:, 0], rtol=0, atol=shown["step"])
    assert shown["truth"]
    assert len(shown["cameras"]) == 4
    np.testing.assert_allclose(shown["cameras"][1]["center"], scene.rig.cameras[1].center_m, atol=1e-4)
    assert set(shown["sides"]) == {"left", "right", "middle"}


def test_long_recordings_are_subsampled_with_a_note(monkeypatch, result):
    monkeypatch.setattr(scene_module, "SHOWN_FRAMES", 7)
    page = render_report(result)
    assert data_of(page)["scene"]["frames"] == list(range(0, 60, 9))
    assert "every 9th frame" in page


def test_large_scenes_are_subsampled(monkeypatch, result):
    monkeypatch.setattr(scene_module, "SHOWN_BYTES", 30_000)
    assert scene_module.display_stride(result) > 1
    assert len(json.dumps(data_of(render_report(result))["scene"]["layers"])) < 30_000


@pytest.mark.parametrize(("stride", "words"), [(2, "2nd"), (3, "3rd"), (12, "12th"), (21, "21st")])
def test_ordinals(stride, words):
    assert scene_note(stride, 0) == f"The scene shows every {words} frame."


def test_distant_outliers_are_omitted_and_counted(result):
    name, layer = result.best_layer()
    points = np.array(layer.points_m)
    points[5, 0, 3] = 1e5
    page = render_report(replace(result, layers={name: replace(layer, points_m=points)}))
    assert "1 distant outlier is not drawn" in page
    assert data_of(page)["scene"]["step"] < 1e-3


def test_page_is_independent_of_the_range_size(monkeypatch, result):
    monkeypatch.setattr(scene_module, "SHOWN_FRAMES", 7)
    whole = render_report(result)
    usual = type(result).windows
    monkeypatch.setattr(type(result), "windows", lambda self, size=10: usual(self, 10))
    assert render_report(result) == whole


def test_findings_come_first(result):
    notes = ("Read.", "Health: Camera <b>3</b> is turned. (90 % certain) Refit it.")
    page = render_report(replace(result, provenance=Provenance(notes=notes)))
    assert "<ol><li>Camera &lt;b&gt;3&lt;/b&gt; is turned." in page
    assert "Findings of the recording check" not in render_report(result)


def test_names_from_files_are_escaped(result):
    hostile = '</script><img src=x onerror="alert(1)">'
    cameras = (replace(result.rig.cameras[0], name=hostile), *result.rig.cameras[1:])
    page = render_report(
        replace(result, rig=replace(result.rig, cameras=cameras), provenance=Provenance(notes=(hostile,)))
    )
    assert hostile not in page
    assert "<img" not in page.replace(html.asset(html.PLOTLY), "")
    assert data_of(page)["charts"]["views"][0] == hostile


def test_single_camera_result_is_labeled_as_image_plane(rng):
    rig = ring(1)
    page = render_report(reconstruct(rig, simulate_detections(rig, body_points(rng, 3), rng)))
    assert "pixels in its image plane" in page
    assert data_of(page)["scene"]["cameras"] == []


def test_unknown_up_axis_is_reported(result):
    page = render_report(replace(result, rig=replace(result.rig, up_axis=None)))
    assert "The up axis of the world is unknown" in page


def test_missing_points_are_counted_and_explained(rng):
    rig = ring(3)
    detections = simulate_detections(rig, body_points(rng, 4), rng)
    keypoints = np.array(detections.keypoints_px)
    keypoints[:, 3] = np.nan
    page = render_report(reconstruct(rig, replace(detections, keypoints_px=keypoints)))
    assert "4 points are missing: no valid detection." in page


def test_keypoint_groups_partition_the_keypoints():
    for name in ("coco_wholebody_133", "body_20", "mouse_22"):
        skeleton = shipped_skeleton(name)
        groups = keypoint_groups(skeleton)
        assert sorted(k for _, places in groups for k in places) == list(range(len(skeleton)))
        assert [group for group, _ in groups] == (
            ["body", "left hand", "right hand", "face"] if name == "coco_wholebody_133" else ["body"]
        )


def test_high_errors_are_listed_with_their_worst_frame(result):
    name, layer = result.best_layer()
    errors, statuses = np.array(layer.view_error_px), np.array(layer.view_status)
    errors[..., 2] *= 3.0
    errors[7, 0, 5, 2] = 999.0
    statuses[7, 0, 5, 2] = ViewStatus.USED
    page = render_report(replace(result, layers={name: replace(layer, view_error_px=errors, view_status=statuses)}))
    highlights = page.split('id="highlights"')[1].split("</section>")[0]
    assert "Camera cam_2 has a high reprojection error" in highlights
    assert 'data-frame-index="7" data-person="0" data-keypoint="5" data-view="2"' in highlights
    assert "Camera cam_1 has a high" not in highlights


def test_empty_result_is_explained(result):
    name, layer = result.best_layer()
    status = np.full(layer.status.shape, PointStatus.TOO_FEW_VIEWS, dtype=np.int8)
    points = np.full(layer.points_m.shape, np.nan)
    page = render_report(replace(result, layers={name: replace(layer, status=status, points_m=points)}))
    assert "No point has coordinates. The most frequent reason: fewer valid views than min_views." in page


def test_rejected_and_little_used_cameras_are_listed(result):
    name, layer = result.best_layer()
    statuses = np.array(layer.view_status)
    statuses[:40, ..., 3] = ViewStatus.UNSEEN
    event = Event(40, 40 / 30, "cam_3", "camera_rejected", "it shows < 15% of the people")
    page = render_report(replace(result, layers={name: replace(layer, view_status=statuses)}, events=(event,)))
    highlights = page.split('id="highlights"')[1].split("</section>")[0]
    assert "cam_3: camera_rejected, it shows &lt; 15% of the people. <button" in highlights
    assert re.search(r"Camera cam_3 contributes to 3\d % of the points", highlights)
    assert "Camera cam_1 contributes" not in highlights


@pytest.mark.parametrize(("duration_s", "origin"), [(0.1, "the measured points"), (2.0, "solved over the whole")])
def test_solved_layer_that_repeats_the_measured_points_says_so(duration_s, origin):
    scene = simulate(SceneOptions(duration_s=duration_s, cameras=4))
    result = reconstruct(scene.rig, scene.detections, Options(solve="trajectory", health="off"))
    assert layer_origin(result, "solved").startswith(origin)
