"""Live sessions: people, dropped frames, and arbitrary input."""

import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import OptionsError, PosefuseWarning
from posefuse.io.stream import encoded, lines_of
from posefuse.live.session import Session
from posefuse.model.options.options import Options
from posefuse.model.options.stream import StreamOptions
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd

ARRIVAL = StreamOptions(when_behind="drop")


@pytest.fixture(scope="module")
def scene() -> CrowdScene:
    return simulate_crowd(CrowdOptions(people=2, cameras=4, duration_s=3.0, seed=1))


@pytest.fixture(scope="module")
def lines(scene: CrowdScene) -> list[tuple[float, bytes]]:
    return list(lines_of(scene.detections))


def session_of(scene: CrowdScene, stream: StreamOptions = ARRIVAL) -> Session:
    return Session(scene.rig, scene.detections.skeleton, Options(), stream)


def process_waiting(session: Session, now_s: float = 0.0) -> list[dict]:
    actual = []
    while session.waiting:
        line = session.process_frame(lambda: now_s)
        if line is not None:
            assert line.endswith(b"\n")
            assert line.count(b"\n") == 1
            actual.append(json.loads(line))
    return actual


def test_output_lines_give_all_people(scene, lines):
    session = session_of(scene, replace(ARRIVAL, clock="messages"))
    frames = []
    for _, line in lines:
        assert session.take(line, 0.0) is None
        frames += process_waiting(session)
    start = json.loads(session.start_line())
    assert start["keypoints"] == list(scene.detections.skeleton.keypoints)
    assert start["cameras"] == list(scene.rig.names)
    assert len(frames) == scene.detections.n_frames
    last = frames[-1]
    assert (last["type"], last["frame"], last["complete"], last["missing"]) == ("frame", 74, True, [])
    assert last["latency_s"] is None
    assert [person["status"] for person in last["people"]] == ["active"] * 2
    truth = np.asarray(scene.truth.layers["measured"].points_m)[-1]
    for person in last["people"]:
        for layer, width in (("keypoints_m", 3), ("covariance_m2", 6), ("model_m", 3), ("model_covariance_m2", 6)):
            assert len(person[layer]) == len(scene.detections.skeleton)
            assert all(row is None or len(row) == width for row in person[layer])
        model = np.array([row or [np.nan] * 3 for row in person["model_m"]])
        assert np.nanmin(np.nanmean(np.linalg.norm(truth - model, axis=-1), axis=1)) < 0.1
        assert set(person["views"]) <= set(scene.rig.names)
        observed = [row is not None for row in person["keypoints_m"]]
        assert observed == [
            label in ("ok", "two_views", "weak_geometry", "ambiguous") for label in person["keypoint_status"]
        ]
    assert [event["what"] for frame in frames for event in frame["events"]].count("confirmed") == 2


def test_tracking_continues_without_a_camera_and_names_it(scene, lines):
    """Camera 1 dies at 1 s and returns at 2 s; of another, a line is lost; frames go on within the wait."""
    session, name = session_of(scene), scene.rig.names[1]
    frames, latest = [], 0.0
    for i, (time_s, line) in enumerate(lines):
        if (f'"{name}"'.encode() in line and 1.0 <= time_s < 2.0) or i == 42:
            continue
        session.tick(time_s)
        session.take(line, time_s)
        frames += process_waiting(session, time_s)
        latest = time_s
    session.end(latest)
    frames += process_waiting(session, latest)
    assert len(frames) == 75
    assert [frame["missing"] for frame in frames if 1.0 <= frame["time_s"] < 2.0] == [[name]] * 25
    assert [person["status"] for person in frames[-1]["people"]] == ["active"] * 2
    assert sum(event["what"] == "lost" for frame in frames for event in frame["events"]) == 0
    report = session.report()
    assert report["frames"] == {"complete": 49, "incomplete": 26, "dropped": 0, "refused": 0}
    assert report["cameras"][name]["missing"] == 25  # type: ignore[index]


def test_times_of_day_give_the_same_people(scene, lines):
    """A double tells them to 0.24 us; no birth or loss is to depend on that."""

    def people(beginning_s: float) -> list[list[dict]]:
        session, frames = session_of(scene, replace(ARRIVAL, clock="messages")), []
        for _, line in lines:
            message = json.loads(line)
            session.take(encoded(message | {"time_s": message["time_s"] + beginning_s}), 0.0)
            frames += process_waiting(session)
        return [frame["people"] for frame in frames]

    for early, late in zip(people(0.0), people(1732275000.0), strict=True):
        assert [(a["id"], a["status"]) for a in early] == [(b["id"], b["status"]) for b in late]
        for a, b in zip(early, late, strict=True):
            models = [np.array([row or [np.nan] * 3 for row in each["model_m"]]) for each in (a, b)]
            np.testing.assert_allclose(*models, atol=1e-5)


def test_last_reported_fault_of_a_kind_says_so(scene):
    session = session_of(scene)
    messages = [session.take(b"[]", 0.0) for _ in range(7)]
    assert [each is None for each in messages] == [False] * 5 + [True] * 2
    assert "Further lines with this fault (wrong shape) are only counted." in (messages[4] or "")


def test_oldest_frames_are_dropped_when_tracking_is_behind(scene, lines):
    session = session_of(scene)
    for time_s, line in lines[:80]:
        session.take(line, time_s)
    frames = process_waiting(session)
    assert [frame["time_s"] for frame in frames] == [time_s for time_s, _ in lines[48:80:4]]
    assert session.counts.frames_dropped == 12


def test_identities_survive_clock_jumps(scene, lines):
    session = session_of(scene)
    frames = []
    for time_s, line in lines:
        message = json.loads(line)
        message["time_s"] += -5000.0 * (time_s >= 1.5)
        session.take(json.dumps(message).encode(), time_s)
        frames += process_waiting(session, time_s)
    assert session.grouper.jumps == 1
    assert len(frames) == 75
    assert frames[-1]["time_s"] < -4000.0
    assert {person["id"] for person in frames[-1]["people"]} == {person["id"] for person in frames[30]["people"]}
    assert sum(event["what"] == "confirmed" for frame in frames for event in frame["events"]) == 2


def test_one_camera_cannot_track(scene):
    with pytest.raises(OptionsError, match="two cameras or more"):
        Session(replace(scene.rig, cameras=scene.rig.cameras[:1]), "body_20", Options(), ARRIVAL)


def test_options_that_need_a_whole_recording_are_refused_or_warned_of(scene):
    filtered = Options(triangulation=TriangulationOptions(method="percentile_filter"))
    with pytest.raises(OptionsError, match="needs the whole recording"):
        Session(scene.rig, "body_20", filtered, ARRIVAL)
    with pytest.warns(PosefuseWarning, match="have no effect in a stream: end_s, solve, pairs"):
        Session(scene.rig, "body_20", Options(end_s=3.0, solve="trajectory", pairs="enumerate"), ARRIVAL)


EXTREMES = [
    "0",
    "-0.0",
    "1e6",
    "-999999",
    "1e-300",
    "1e308",
    "-1e400",
    "99999999999999999999",
    "null",
    '"x"',
    "[]",
    "NaN",
]


def fuzzed(lines: list[bytes], number: int, seed: int) -> Iterator[bytes]:
    """Lines of which most are broken in some way."""
    rng = np.random.default_rng(seed)
    for i in range(number):
        line = lines[i % len(lines)].strip()
        kind = rng.choice(8, p=[0.32, 0.24, 0.24, 0.15, 0.005, 0.005, 0.03, 0.01])
        if kind == 0:
            data = bytearray(line)
            for at in rng.integers(0, len(data), rng.integers(1, 9)):
                data[at] = rng.integers(256)
            line = bytes(data)
        elif kind == 1:
            line = line[: rng.integers(len(line))]
        elif kind == 2:
            other = lines[rng.integers(len(lines))]
            line = line[: rng.integers(len(line))] + other[rng.integers(len(other)) :]
        elif kind == 3:
            line = rng.bytes(rng.integers(1, 60))
        elif kind <= 5:
            message = json.loads(line)
            for person in message["people"]:
                for k in rng.integers(0, len(person["keypoints"]), 4):
                    person["keypoints"][k] = [float(x) for x in rng.normal(size=3) * 10.0 ** rng.integers(-300, 7)]
                    person["keypoints"][k][2] = abs(person["keypoints"][k][2])
            message["time_s"] += rng.normal() * 10.0 ** rng.integers(-9, 9) * (rng.random() < 0.2)
            message["people"] = message["people"] * int(rng.integers(0, 4))
            line = json.dumps(message).encode()
        elif kind == 6:
            fields = line.split(b",")
            fields[rng.integers(len(fields))] = EXTREMES[rng.integers(len(EXTREMES))].encode()
            line = b",".join(fields)
        yield line


def follow_fuzzed(scene: CrowdScene, lines: list[tuple[float, bytes]], number: int, seed: int) -> Session:
    session = session_of(scene, replace(ARRIVAL, queue_frames=2))
    for time_s, line in lines[:160]:
        session.take(line, time_s - 2.0)
        process_waiting(session)
    for i, line in enumerate(fuzzed([line for _, line in lines], number, seed)):
        session.take(line, 0.01 * i)
        session.tick(0.01 * i + 0.005)
        for frame in process_waiting(session, 0.01 * i):
            assert frame["type"] == "frame"
    assert session.counts.lines == number + 160
    assert session.counts.malformed.total() > number / 4
    assert session.counts.complete + session.counts.incomplete > number / 200
    json.loads(session.report_line(last=True))
    return session


def test_no_input_line_stops_the_session(scene, lines):
    follow_fuzzed(scene, lines, 20_000, 1)


@pytest.mark.long
def test_none_of_a_million_lines_stops_the_session(scene, lines):
    follow_fuzzed(scene, lines, 1_000_000, 2)
