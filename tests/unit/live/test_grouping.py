"""Grouping of views into frames, for any order, loss and delay; no test depends on the clock."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.live.grouping import Group, Grouper
from posefuse.model.options.stream import StreamOptions
from posefuse.model.view_message import ViewMessage
from tests.properties import examples

OPTIONS = StreamOptions()
PERIOD_S = 0.02


def view(camera: int, time_s: float) -> ViewMessage:
    return ViewMessage(camera, time_s, np.empty((0, 17, 2)), np.empty((0, 17)), np.empty(0, dtype=np.int64))


def feed(grouper: Grouper, messages: Iterable[tuple[float, int, float]]) -> list[Group]:
    """Messages as when they arrive, camera, time; ends the stream a second after the last."""
    groups, last = [], 0.0
    for now_s, camera, time_s in messages:
        grouper.take(view(camera, time_s), now_s)
        groups += grouper.ready()
        last = now_s
    grouper.tick(last + 1.0)
    grouper.end(last + 1.0)
    return groups + grouper.ready()


def steady(
    frames: int, cameras: int = 4, start_s: float = 0.0, offset_s: float = 0.0
) -> list[tuple[float, int, float]]:
    """A stream without a fault; times are ``offset_s`` from when messages arrive."""
    return [
        (start_s + f * PERIOD_S + 1e-4 * v, v, start_s + f * PERIOD_S + offset_s)
        for f in range(frames)
        for v in range(cameras)
    ]


def stream_times(groups: Iterable[Group]) -> list[float]:
    return [group.time_s + group.shift_s for group in groups]


def test_complete_frames_are_closed_with_their_last_view():
    grouper = Grouper(4, OPTIONS)
    for now_s, camera, time_s in steady(3):
        grouper.take(view(camera, time_s), now_s)
        groups = grouper.ready()
        assert len(groups) == (camera == 3)
        for group in groups:
            assert group.complete
            assert (group.reason, group.time_s, group.due_s) == ("complete", time_s, now_s)
            assert [each.view for each in group.views] == [0, 1, 2, 3]


def test_frame_waits_for_max_wait_s_only():
    grouper = Grouper(3, OPTIONS)
    for camera in (0, 1):
        grouper.take(view(camera, 5.0), 100.0)
    grouper.tick(100.0499)
    assert grouper.ready() == []
    assert grouper.wakes_at_s() == pytest.approx(100.05)
    grouper.tick(100.0501)
    (group,) = grouper.ready()
    assert (group.reason, group.complete, group.due_s) == ("waited", False, pytest.approx(100.05))
    assert grouper.counts[2].missing == 1
    grouper.take(view(2, 5.0), 100.06)
    grouper.take(view(0, 5.001), 100.06)
    assert grouper.ready() == []
    assert (grouper.counts[2].late, grouper.counts[0].duplicate) == (1, 1)


def test_lost_view_does_not_delay_the_next_frame():
    grouper = Grouper(4, OPTIONS)
    messages = steady(2)
    del messages[2]
    *_, last = messages
    for now_s, camera, time_s in messages:
        grouper.take(view(camera, time_s), now_s)
    first, second = grouper.ready()
    assert (first.reason, first.complete, first.due_s) == ("overtaken", False, last[0])
    assert (second.reason, second.complete) == ("complete", True)


def test_views_in_any_order_within_the_wait_are_used():
    messages = steady(10)
    messages[8], messages[12] = (messages[12][0], *messages[8][1:]), (messages[8][0], *messages[12][1:])
    grouper = Grouper(4, OPTIONS)
    groups = feed(grouper, sorted(messages))
    assert all(group.complete for group in groups)
    assert len(groups) == 10
    assert [count.out_of_order for count in grouper.counts] == [1, 0, 0, 0]


def test_frames_do_not_wait_for_a_silent_camera():
    messages = [each for each in steady(150) if not (each[1] == 2 and 0.5 <= each[2] < 2.0)]
    grouper = Grouper(4, OPTIONS)
    groups = feed(grouper, messages)
    assert len(groups) == 150
    late = [group for group in groups if 1.1 <= group.time_s < 2.0]
    assert all(group.reason == "complete" and not group.complete for group in late)
    assert all(group.complete for group in groups if group.time_s >= 2.0)
    assert grouper.counts[2].missing == 75


def test_pause_of_all_cameras_makes_none_silent():
    grouper = Grouper(4, OPTIONS)
    groups = feed(grouper, [*steady(20), *steady(20, start_s=7.0)])
    assert len(groups) == 40
    assert all(group.complete for group in groups)


def test_clock_that_is_ahead_delays_no_other_camera():
    """A clock that is ahead by more than the wait and less than a jump still matches its frames."""
    messages = [(now, v, t + 0.3 * (v == 1)) for now, v, t in steady(100)]
    grouper = Grouper(4, OPTIONS)
    groups = feed(grouper, messages)
    assert sum(group.complete for group in groups) >= 80
    assert stream_times(groups) == sorted(stream_times(groups))
    assert all(grouper.counts[v].late == 0 for v in (0, 2, 3))


@pytest.mark.parametrize(("hours", "counted"), [(1.0, "early"), (-1.0, "late")])
def test_single_clock_that_jumps_is_ignored(hours: float, counted: str):
    messages = [(now, v, t + 3600.0 * hours * (v == 1 and t >= 1.0)) for now, v, t in steady(100)]
    grouper = Grouper(4, OPTIONS)
    groups = feed(grouper, messages)
    assert len(groups) == 100
    assert grouper.jumps == 0
    assert getattr(grouper.counts[1], counted) == 50
    assert all(group.views[v] is not None for group in groups for v in (0, 2, 3))


@pytest.mark.parametrize("hours", [1.0, -1.0])
@pytest.mark.parametrize("clock", ["arrival", "messages"])
def test_stream_follows_a_jump_of_most_clocks(hours: float, clock: str):
    grouper = Grouper(4, replace(OPTIONS, clock=clock))
    groups = feed(grouper, [(now, v, t + 3600.0 * hours * (t >= 1.0)) for now, v, t in steady(100)])
    # By messages alone, an hour ahead is an hour gone by; else clocks were set.
    gone_by = (clock, hours) == ("messages", 1.0)
    assert grouper.jumps == (0 if gone_by else 1)
    assert len(groups) == 100
    assert all(group.complete for group in groups)
    apart = np.diff(stream_times(groups))
    gap = apart[49]
    np.testing.assert_allclose(np.delete(apart, 49), PERIOD_S, atol=1e-6)
    assert gap == pytest.approx(3600.0 + PERIOD_S if gone_by else PERIOD_S, abs=1e-3)
    assert not gone_by or {group.shift_s for group in groups} == {0.0}


def test_times_of_day_are_accepted():
    grouper = Grouper(4, OPTIONS)
    groups = feed(grouper, [(now, v, 1.7e9 + t) for now, v, t in steady(20)])
    assert [group.complete for group in groups] == [True] * 20
    assert {group.shift_s for group in groups} == {0.0}


def test_at_most_open_frames_wait():
    grouper = Grouper(3, replace(OPTIONS, open_frames=4, max_wait_s=0.9))
    for f in range(20):
        for camera in (0, 1):
            grouper.take(view(camera, f * PERIOD_S), f * PERIOD_S)
    assert [group.reason for group in grouper.ready()] == ["crowded"] * 16


def test_clock_that_is_ahead_does_not_displace_other_frames():
    """What one camera alone has come to waits, so many frames of it that others' would have to go on unfinished."""
    rate_hz, ahead_s = 120.0, 0.6
    grouper = Grouper(4, OPTIONS)
    messages = [(f / rate_hz + 1e-4 * v, v, f / rate_hz + ahead_s * (v == 3)) for f in range(360) for v in range(4)]
    groups = [group for group in feed(grouper, messages) if group.time_s < 2.0]
    assert len(groups) == pytest.approx(2.0 * rate_hz, abs=2)
    assert all(group.views[v] is not None for group in groups for v in range(3))
    assert [grouper.counts[v].late for v in range(3)] == [0, 0, 0]


@pytest.mark.parametrize("error_s", [0.6, 5.0, 1e6])
def test_wrong_clock_is_not_accepted_while_the_others_stall(error_s: float):
    grouper = Grouper(4, OPTIONS)
    messages = [(now, v, t + error_s * (v == 0)) for now, v, t in steady(200) if v == 0 or not 2.0 <= t < 2.25]
    groups = feed(grouper, messages)
    assert grouper.jumps == 0
    assert max(np.diff(stream_times(groups))) < 0.5
    assert [grouper.counts[v].late for v in (1, 2, 3)] == [0, 0, 0]


def test_with_message_clocks_a_gap_of_some_views_does_not_affect_the_others():
    rate_hz = 120.0
    messages = [(0.0, v, f / rate_hz) for f in range(600) for v in range(2) if v == 0 or not 2.0 <= f / rate_hz < 2.9]
    grouper = Grouper(2, replace(OPTIONS, clock="messages"))
    groups = feed(grouper, messages)
    assert len(groups) == 600
    assert [count.early for count in grouper.counts] == [0, 0]


@pytest.mark.parametrize(("cameras", "left"), [(2, 1), (3, 1), (6, 2)])
def test_with_message_clocks_the_remaining_cameras_continue(cameras: int, left: int):
    messages = [(now, v, t) for now, v, t in steady(500, cameras) if v < left or t < 2.0]
    grouper = Grouper(cameras, replace(OPTIONS, clock="messages"))
    assert len(feed(grouper, messages)) == 500


@pytest.mark.parametrize("cameras", [2, 3, 4])
def test_frames_of_the_last_active_camera_do_not_wait(cameras: int):
    grouper, waited = Grouper(cameras, OPTIONS), []
    for now_s, camera, time_s in steady(200, cameras):
        if camera == 0 or time_s < 2.0:
            grouper.take(view(camera, time_s), now_s)
        grouper.tick(now_s)
        waited += [now_s - group.first_s for group in grouper.ready()]
    assert max(waited) < OPTIONS.max_wait_s + 6 * PERIOD_S


@st.composite
def streams(draw: st.DrawFn) -> tuple[int, list[tuple[float, int, float]]]:
    """Any stream: lost, doubled and delayed messages, wrong clocks, in the order of their arrival."""
    cameras = draw(st.integers(1, 5))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    sent = steady(draw(st.integers(1, 40)), cameras)
    faults = draw(st.lists(st.sampled_from(["lost", "doubled", "delayed", "jumped", "set back", "odd"]), max_size=4))
    for fault in faults:
        share = rng.random(len(sent)) < 0.1
        if fault == "lost":
            sent = [each for each, chosen in zip(sent, share, strict=True) if not chosen]
        elif fault == "doubled":
            sent += [each for each, chosen in zip(sent, share, strict=True) if chosen]
        elif fault == "delayed":
            sent = [(n + 0.2 * rng.random() * c, v, t) for (n, v, t), c in zip(sent, share, strict=True)]
        elif fault == "odd":
            sent = [
                (n, v, t + c * rng.normal(0.0, 10.0 ** rng.uniform(-3, 9)))
                for (n, v, t), c in zip(sent, share, strict=True)
            ]
        else:
            from_s, by_s = rng.uniform(0.0, 1.0), rng.uniform(1.0, 1e4) * (1 if fault == "jumped" else -1)
            sent = [(n, v, t + by_s * (n >= from_s)) for n, v, t in sent]
    return cameras, sorted(sent)


@given(streams(), st.sampled_from(["arrival", "messages"]))
@examples(150)
def test_every_view_is_in_one_frame_or_counted_once(stream, clock):
    cameras, messages = stream
    grouper = Grouper(cameras, replace(OPTIONS, clock=clock))
    groups = feed(grouper, messages)
    times = stream_times(groups)
    assert all(later > sooner for sooner, later in pairwise(times))
    for camera, count in enumerate(grouper.counts):
        assert count.received == sum(v == camera for _, v, _ in messages)
        assert count.received == count.used + count.late + count.early + count.duplicate
        assert count.used == sum(group.views[camera] is not None for group in groups)
        assert count.missing == len(groups) - count.used
    for group in groups:
        other = [each for each in group.views if each is not None]
        assert other
        assert all(abs(each.time_s - group.time_s) <= OPTIONS.same_time_s for each in other)


@given(streams())
@examples(50)
def test_with_message_clocks_arrival_times_do_not_matter(stream):
    cameras, messages = stream
    options = replace(OPTIONS, clock="messages")
    one = feed(Grouper(cameras, options), messages)
    other = feed(Grouper(cameras, options), [(0.0, v, t) for _, v, t in messages])
    shown = [[(g.time_s, g.shift_s, [each is not None for each in g.views]) for g in groups] for groups in (one, other)]
    assert shown[0] == shown[1]
