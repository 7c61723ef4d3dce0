"""Explanation of a frame: every detection with its track and error."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import DetectionsError, ResultError
from posefuse.evaluation.visibility import count_misses
from posefuse.explain import explain
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import ViewStatus
from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState
from posefuse.synthetic.crowds import Kind
from tests.people import simulate_walkers, track_perfectly

AWAY = 20
"""A frame in which the last person is away."""


@pytest.fixture(scope="module")
def scene():
    return simulate_walkers(seconds=2.0)


@pytest.fixture(scope="module")
def result(scene) -> Reconstruction:
    return replace(track_perfectly(scene), swaps=None)


def test_every_detection_is_listed_once_with_its_track(scene, result):
    for number in (5, AWAY, 49):
        explanation = explain(result, number, scene.detections)
        cells = scene.detections.offsets[number * 5 : number * 5 + 6]
        for v, view in enumerate(explanation.views):
            assert [each.number for each in view.detections] == list(range(cells[v + 1] - cells[v]))
            for each in view.detections:
                p = -1 if each.person is None else result.person_ids.index(each.person)
                assert p == -1 or result.tracks.detection[number, p, v] == each.number
                assert (p == -1) == (each.number not in result.tracks.detection[number, :, v])
                visible = np.isfinite(scene.detections.keypoints_px[cells[v] + each.number, :, 0]).sum()
                assert each.n_keypoints == visible


def test_errors_are_distances_to_the_projected_person(scene, result):
    explanation = explain(result, 10, scene.detections)
    one = next(each for each in explanation.views[2].detections if each.person == "person_1")
    points = result.layers["model"].points_m[10, 0]
    row = scene.detections.offsets[10 * 5 + 2] + one.number
    off = np.linalg.norm(result.rig.cameras[2].project(points)[0] - scene.detections.keypoints_px[row], axis=-1)
    assert one.error_px["model"] == pytest.approx(np.nanmedian(off), rel=1e-5)


def test_unassigned_detections_have_the_right_reason(scene, result):
    """The simulation provides the true false and duplicate detections."""
    reasons: dict[Kind, list[str]] = {}
    for number in range(result.n_frames):
        for v, view in enumerate(explain(result, number, scene.detections).views):
            for each in view.detections:
                row = scene.detections.offsets[number * 5 + v] + each.number
                # Detections of people without a track count as unassigned.
                owner = scene.owner[row]
                reference = owner < 0 or np.isfinite(np.asarray(result.layers["model"].points_m)[number, owner]).any()
                if each.person is None and reference:
                    reasons.setdefault(Kind(scene.kind[row]), []).append(each.why)
    assert all("no person here" in why or "is tracked" in why for why in reasons[Kind.FALSE])
    assert reasons[Kind.DUPLICATE]
    assert all("a duplicate" in why for why in reasons[Kind.DUPLICATE])


def test_missed_detection_is_reported_with_its_position(scene, result):
    detection = np.array(result.tracks.detection)
    number = int(detection[10, 0, 2])
    detection[10, 0, 2] = -1
    odd = replace(result, tracks=replace(result.tracks, detection=detection))
    view = explain(odd, 10, scene.detections).views[2]
    assert view.undetected["person_1"] == f"should be visible; detected there: detection {number} (unassigned)"
    assert view.detections[number].why.startswith("near person_1 (active), not assigned")
    nothing = replace(odd, tracks=replace(odd.tracks, detection=np.full_like(detection, -1)))
    assert "unknown without the 2D keypoints" in explain(nothing, 10).views[2].undetected["person_1"]


def test_without_keypoints_only_the_result_is_explained(scene, result):
    explanation, whole = explain(result, 10), explain(result, 10, scene.detections)
    assert (explanation.complete, whole.complete) == (False, True)
    for first, second in zip(explanation.views, whole.views, strict=True):
        theirs_owned = [each for each in second.detections if each.person is not None]
        assert [(e.number, e.person, e.n_used) for e in first.detections] == [
            (e.number, e.person, e.n_used) for e in theirs_owned
        ]
        assert all(each.n_keypoints is None for each in first.detections)


def test_people_are_listed_with_their_states(result):
    explanation = explain(result, 10)
    assert [(p.name, p.state, p.since) for p in explanation.people][:2] == [
        ("person_1", TrackState.ACTIVE, 3), ("person_2", TrackState.ACTIVE, 3),
    ]  # fmt: skip
    assert "person_4" not in [person.name for person in explain(result, AWAY).people]
    layer = explanation.people[0].layers[1]
    assert (layer.layer, layer.n_points, layer.sd_mm) == ("model", 20, pytest.approx(10))


def test_single_person(scene, result):
    explanation = explain(result, 10, scene.detections, "person_2")
    assert [person.name for person in explanation.people] == ["person_2"]
    assert {each.person for view in explanation.views for each in view.detections} <= {"person_2", None}
    events = (Event(9, 0.36, "person_1", "lost", "a"), Event(9, 0.36, "cam_1", "camera_rejected", "b"))
    assert explain(replace(result, events=events), 10, None, "person_2").events == events[1:]


def test_events_of_the_second_before_and_after(result):
    events = tuple(Event(f, f / 25, "person_1", "lost", "x") for f in (0, 3, 40, 55, 58))
    assert [event.number for event in explain(replace(result, events=events), 30).events] == [40, 55]


def test_invalid_requests_are_refused(scene, result):
    with pytest.raises(ResultError, match="frames 0 to 49. Choose a frame"):
        explain(result, 77)
    with pytest.raises(ResultError, match="no person 'person_9'"):
        explain(result, 7, None, "person_9")
    with pytest.raises(ResultError, match="not computed from detections"):
        explain(replace(result, tracks=None), 7)
    with pytest.raises(DetectionsError, match="have no frame 30, only 0 to 9; the result"):
        explain(result, 30, scene.detections.frames(0, 10))
    detection = np.array(result.tracks.detection)
    detection[7, 0, 1] = 12
    wrong = replace(result, tracks=replace(result.tracks, detection=detection))
    with pytest.raises(DetectionsError, match=r"Camera cam_1 has \d detections .* uses detection 12"):
        explain(wrong, 7, scene.detections)


class TestMisses:
    def test_misses_match_hand_computed_values(self, result):
        misses = count_misses(result.chunks(7), "model")
        state, detection = np.asarray(result.tracks.state), np.asarray(result.tracks.detection)
        active = state == TrackState.ACTIVE
        # Every camera shows the whole room.
        np.testing.assert_array_equal(misses.expected, np.repeat(active.sum(axis=0)[:, None], 5, axis=1))
        missed = ((detection < 0) & active[..., None]).sum(axis=0)
        np.testing.assert_array_equal(misses.missed, missed)
        assert missed.sum() > 0

    def test_people_outside_the_image_or_not_recorded_are_not_missed(self, result):
        layer = result.layers["model"]
        far = replace(layer, points_m=np.asarray(layer.points_m) + np.array([0, 0, 50.0]))
        assert count_misses([replace(result, layers={"model": far})], "model").expected.sum() == 0
        status = np.array(layer.view_status)
        status[:, :, :, 2] = ViewStatus.NOT_RECORDED
        dark = replace(layer, view_status=status)
        expected = count_misses([replace(result, layers={"model": dark})], "model").expected
        assert expected[:, 2].sum() == 0
        assert (expected[:, 1] > 0).all()
        assert np.isnan(count_misses([replace(result, layers={"model": dark})], "model").share[:, 2]).all()

    def test_recording_without_tracks(self, result):
        assert count_misses([replace(result, tracks=None)], "model") is None
