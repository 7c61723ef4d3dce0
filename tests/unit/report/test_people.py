"""The report of many people: life lines, their events, and which cameras missed whom."""

import base64
import json
import re
import time
from dataclasses import replace

import numpy as np
import pytest

from posefuse.evaluation.sightings import count_misses
from posefuse.model.status import PointStatus
from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState
from posefuse.report.html import render_report
from posefuse.report.people import events_in_words, life_lines, lives
from posefuse.report.summary import summarise
from tests.people import TENTATIVE_FRAMES, crowd, followed, nobody


@pytest.fixture(scope="module")
def scene():
    return crowd()


@pytest.fixture(scope="module")
def result(scene):
    return followed(scene)


def data_of(page: str) -> dict:
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found
    return json.loads(found.group(1))


def test_everybody_is_in_the_scene(scene, result):
    shown = data_of(render_report(result, scene.truth))["scene"]
    assert shown["people"] == list(result.person_ids)
    assert [layer["name"] for layer in shown["layers"]] == ["model", "measured"]
    for p, packed in enumerate(shown["layers"][0]["points"]):
        steps = np.frombuffer(base64.b64decode(packed), "<i2").reshape(50, 20, 3)
        points = np.array(shown["middle"]) + shown["step"] * np.where(steps == -32768, np.nan, steps)
        np.testing.assert_allclose(points, result.layers["model"].points_m[:, p], rtol=0, atol=shown["step"])
    assert len(shown["truth"]) == 4


def test_life_lines_are_the_states(result):
    told = life_lines(result)
    drawn = np.zeros(result.tracks.state.shape, dtype=int)
    for p, runs in enumerate(told["runs"]):
        for state, a, b in runs:
            drawn[a:b, p] = TrackState[state.upper()]
    np.testing.assert_array_equal(drawn, result.tracks.state)
    assert told["unit"] == "s"
    np.testing.assert_allclose(told["time"], np.arange(51) / 25)
    assert [(row, what, number) for _, row, what, _, number in told["events"]] == [
        (result.person_ids.index(event.person), event.what, event.number) for event in result.events
    ]


def test_events_of_a_camera_have_a_row_of_their_own(result):
    event = Event(7, 0.28, "cam_1", "camera refused", "it disagrees")
    told = life_lines(replace(result, events=(event,)))
    assert told["rows"] == [*result.person_ids, "cam_1"]
    assert (told["people"], told["events"]) == (4, [[7, 4, "camera refused", "it disagrees", 7]])


def test_numbers_of_a_life(result):
    everybody = lives(result.chunks(7), "model")
    assert everybody == lives(result.chunks(), "model")
    first, last = everybody[0], everybody[3]
    assert (first.first, first.last, first.frames[TrackState.TENTATIVE]) == (0, 49, TENTATIVE_FRAMES)
    assert last.frames[TrackState.ABSENT] > 0
    assert first.n_views == pytest.approx((np.asarray(result.tracks.detection)[3:, 0] >= 0).sum(axis=-1).mean())


def test_who_is_absent_has_no_missing_points(result):
    summary = summarise(result.chunks(), "model")
    there = np.asarray(result.tracks.state) != TrackState.ABSENT
    assert summary.n_points == 20 * there.sum()
    assert summary.status_counts == {
        code: n for code in PointStatus if (n := int((np.asarray(result.layers["model"].status)[there] == code).sum()))
    }


def test_the_page_tells(result):
    page = render_report(result)
    share = count_misses(result.chunks(), "model").share
    assert f'">{100 * share[2, 0]:.1f} %</td>' in page
    for words in (
        "People over time",
        "<h3>Missed</h3>",
        "One colour a person",
        f"Events: {events_in_words(result.events)}",
    ):
        assert words in page
    assert page == render_report(result)


def test_names_cannot_run(result):
    hostile = '</script><img src=x onerror="alert(1)">'
    ids = (hostile, *result.person_ids[1:])
    events = (Event(3, 0.12, hostile, "lost", hostile),)
    page = render_report(replace(result, person_ids=ids, tracks=replace(result.tracks, person_ids=ids), events=events))
    assert hostile not in page


def test_nobody(scene):
    page = render_report(nobody(scene))
    assert "0 people" in page
    assert "Nobody was found." in page
    assert "Nothing stands out" not in page
    assert data_of(page)["scene"]["people"] == []


def test_one_person_to_whom_nothing_happens_is_shown_as_before(result):
    from posefuse.editing import apply_edits
    from posefuse.model.edits import Drop

    alone = replace(apply_edits(result, [Drop(name) for name in result.person_ids[1:]]), events=())
    page = render_report(alone)
    assert "People over time" not in page
    assert '<span class="left">Left</span>' in page
    assert data_of(page)["lives"] is None


@pytest.mark.long
def test_ten_minutes_are_written_in_fifteen_seconds():
    short = followed(crowd(people=2, seconds=10.0))
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
