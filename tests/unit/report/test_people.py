"""The report of several people: track states, events, and missed detections."""

import base64
import json
import re
import time
from dataclasses import replace

import numpy as np
import pytest

from posefuse.evaluation.visibility import count_misses
from posefuse.model.status import PointStatus, is_used
from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState
from posefuse.report.html import render_report
from posefuse.report.people import format_event_counts, summarize_people, track_timeline
from posefuse.report.summary import summarize
from tests.people import TENTATIVE_FRAMES, simulate_walkers, track_perfectly, without_people


@pytest.fixture(scope="module")
def scene():
    return simulate_walkers()


@pytest.fixture(scope="module")
def result(scene):
    return track_perfectly(scene)


def data_of(page: str) -> dict:
    actual = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert actual
    return json.loads(actual.group(1))


def test_people_are_in_the_scene(scene, result):
    shown = data_of(render_report(result, np.asarray(scene.truth.layers["measured"].points_m)))["scene"]
    assert shown["people"] == list(result.person_ids)
    assert [layer["name"] for layer in shown["layers"]] == ["model", "measured"]
    for p, packed in enumerate(shown["layers"][0]["points"]):
        steps = np.frombuffer(base64.b64decode(packed), "<i2").reshape(50, 20, 3)
        points = np.array(shown["origin"]) + shown["step"] * np.where(steps == -32768, np.nan, steps)
        np.testing.assert_allclose(points, result.layers["model"].points_m[:, p], rtol=0, atol=shown["step"])
    assert len(shown["truth"]) == 4


def test_timeline_matches_the_track_states(result):
    timeline = track_timeline(result)
    drawn = np.zeros(result.tracks.state.shape, dtype=int)
    for p, runs in enumerate(timeline["runs"]):
        for state, a, b in runs:
            drawn[a:b, p] = TrackState[state.upper()]
    np.testing.assert_array_equal(drawn, result.tracks.state)
    assert timeline["unit"] == "s"
    np.testing.assert_allclose(timeline["time"], np.arange(51) / 25)
    assert [(row, what, number) for _, row, what, _, number in timeline["events"]] == [
        (result.person_ids.index(event.person), event.what, event.number) for event in result.events
    ]


def test_camera_events_have_a_separate_row(result):
    event = Event(7, 0.28, "cam_1", "camera_rejected", "it disagrees")
    timeline = track_timeline(replace(result, events=(event,)))
    assert timeline["rows"] == [*result.person_ids, "cam_1"]
    assert (timeline["people"], timeline["events"]) == (4, [[7, 4, "camera_rejected", "it disagrees", 7]])


def test_person_statistics(result):
    people = summarize_people(result.chunks(7), "model")
    assert people == summarize_people(result.chunks(), "model")
    first, last = people[0], people[3]
    assert (first.first, first.last, first.frames[TrackState.TENTATIVE]) == (0, 49, TENTATIVE_FRAMES)
    assert last.frames[TrackState.ABSENT] > 0
    assert first.n_views == pytest.approx((np.asarray(result.tracks.detection)[3:, 0] >= 0).sum(axis=-1).mean())


def test_medians_of_people_and_of_cameras_are_over_the_same_errors(result):
    summary = summarize(result.chunks(), "model")
    layer = result.layers["model"]
    used = (
        is_used(np.asarray(layer.view_status)) & (np.asarray(result.tracks.state) != TrackState.ABSENT)[..., None, None]
    )
    errors = np.where(used, np.asarray(layer.view_error_px), np.nan).astype(np.float32)
    page = render_report(result)
    for p, person in enumerate(result.person_ids):
        median = float(np.nanmedian(errors[:, p]))
        assert summary.error_px_by_person[p].median == pytest.approx(median)
        row = page.split(f"<td>{person}</td>")[1].split("</tr>")[0]
        assert row.endswith(f"<td>{median:.2f}</td>")
    assert sum(each.count for each in summary.error_px_by_person) == sum(e.count for e in summary.error_px_by_view)


def test_absent_people_have_no_missing_points(result):
    summary = summarize(result.chunks(), "model")
    present = np.asarray(result.tracks.state) != TrackState.ABSENT
    assert summary.n_points == 20 * present.sum()
    assert summary.status_counts == {
        code: n
        for code in PointStatus
        if (n := int((np.asarray(result.layers["model"].status)[present] == code).sum()))
    }


def test_page_lists_people_events_and_misses(result):
    page = render_report(result)
    share = count_misses(result.chunks(), "model").share
    assert f'">{100 * share[2, 0]:.1f} %</td>' in page
    for words in (
        "People over time",
        "<h3>Missed detections</h3>",
        "One color per person",
        f"Events: {format_event_counts(result.events)}",
    ):
        assert words in page
    assert page == render_report(result)


def test_names_are_escaped(result):
    hostile = '</script><img src=x onerror="alert(1)">'
    ids = (hostile, *result.person_ids[1:])
    events = (Event(3, 0.12, hostile, "lost", hostile),)
    page = render_report(replace(result, person_ids=ids, tracks=replace(result.tracks, person_ids=ids), events=events))
    assert hostile not in page


def test_result_without_people(scene):
    page = render_report(without_people(scene))
    assert "0 people" in page
    assert "No person was found." in page
    assert "Nothing stands out" not in page
    assert data_of(page)["scene"]["people"] == []


def test_single_person_without_events_has_no_people_section(result):
    from posefuse.editing import apply_edits
    from posefuse.model.edits import Drop

    alone = replace(apply_edits(result, [Drop(name) for name in result.person_ids[1:]]), events=())
    page = render_report(alone)
    assert "People over time" not in page
    assert '<span class="left">Left</span>' in page
    assert data_of(page)["tracks"] is None


@pytest.mark.long
def test_ten_minute_report_takes_less_than_15_s():
    short = track_perfectly(simulate_walkers(people=2, seconds=10.0))
    n = short.n_frames
    parts = [
        replace(short, frame_numbers=short.frame_numbers + i * n, time_s=short.time_s + i * n / 25, events=())
        for i in range(60)
    ]
    whole = type(short).concatenate(parts)
    started = time.process_time()
    page = render_report(whole)
    assert time.process_time() - started < 15
    assert len(page) < 15e6
