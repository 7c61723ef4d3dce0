"""``posefuse stream`` as a user runs it: a process, lines in, lines out."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posefuse
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.io.stream import lines_of
from posefuse.model.options.options import Options
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-W", "error::RuntimeWarning", "-m", "posefuse"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "COLUMNS": "80"}
FIXED = ("--noise-scale-px", "6", "--pairs", "labels")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of two people for two seconds, with a view that drops frames."""
    made = simulate_crowd(CrowdOptions(people=2, cameras=4, duration_s=2.0, seed=3))
    path = tmp_path_factory.mktemp("crowd")
    native.write(made.detections, path / "keypoints.nc")
    anipose.write(made.rig, path / "calibration.toml")
    return path


@pytest.fixture(scope="module")
def lines(folder: Path) -> bytes:
    rig = posefuse.read_cameras(folder / "calibration.toml")
    return b"".join(line for _, line in lines_of(posefuse.read_detections(folder / "keypoints.nc"), rig.names))


def stream(folder: Path, *more: str) -> list[str]:
    return [*COMMAND, "stream", "--calibration", str(folder / "calibration.toml"), "--skeleton", "body_20", *more]


def test_streamed_recording_gives_the_numbers_of_reconstruct(run, folder, lines):
    assert run("replay", folder) == (0, lines.decode(), "")
    done = subprocess.run(
        stream(folder, "--clock", "messages", *FIXED), input=lines, capture_output=True, check=True, env=ENVIRONMENT
    )
    tracker = replace(Options().tracker, smoother="none")
    options = Options(people="many", noise_scale_px=6.0, pairs="labels", tracker=tracker)
    rig = posefuse.read_cameras(folder / "calibration.toml")
    result = posefuse.reconstruct(rig, posefuse.read_detections(folder / "keypoints.nc"), options)
    start, *frames, report = [json.loads(line) for line in done.stdout.splitlines()]
    assert (start["type"], start["protocol"], report["type"], report["last"]) == ("start", 1, "report", True)
    assert [frame["frame"] for frame in frames] == list(range(result.n_frames))
    compared = 0
    for f, frame in enumerate(frames):
        for person in frame["people"]:
            if person["status"] != "active":
                continue
            p = result.person_ids.index(person["id"])
            for layer, points, covariance in (
                ("model", "model_m", "model_covariance_m2"), ("measured", "keypoints_m", "covariance_m2"),
            ):  # fmt: skip
                reference = result.layers[layer]
                assert_same(person[points], np.asarray(reference.points_m)[f, p])
                assert_same(person[covariance], np.asarray(reference.covariance_m2)[f, p])
            compared += 1
    assert compared > 60
    assert all(len(line) <= 80 for line in done.stderr.decode().splitlines())


def assert_same(rows: list, expected: np.ndarray) -> None:
    results = np.array([[np.nan] * expected.shape[1] if row is None else row for row in rows])
    # Missing points have no covariance either.
    np.testing.assert_allclose(results, np.where(np.isnan(results), np.nan, expected), rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(np.isnan(results[:, 0]), np.isnan(expected[:, 0]))


def test_stream_over_tcp_ends_on_a_signal(folder, lines):
    with subprocess.Popen(
        stream(folder, "--input", "tcp://:0", "--max-jump-s", "5"), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env=ENVIRONMENT,
    ) as process:  # fmt: skip
        assert process.stderr is not None
        ready = process.stderr.readline().decode()
        address = re.search(r"listening on tcp://127\.0\.0\.1:(\d+)", ready)
        assert address, ready + process.stderr.read().decode()
        results: list[dict] = []
        reading = threading.Thread(
            target=lambda: results.extend(json.loads(line) for line in _lines(process)), daemon=True
        )
        reading.start()
        count = 40
        with socket.create_connection(("127.0.0.1", int(address[1]))) as sender:
            sender.sendall(b"nonsense\n")
            for i in range(0, 4 * count, 4):
                sender.sendall(b"".join(line + b"\n" for line in lines.splitlines()[i : i + 4]))
                time.sleep(0.04)
            time.sleep(0.5)
        process.send_signal(signal.SIGTERM)
        reading.join(60)
        output = process.stderr.read().decode()
        assert process.wait(60) == 0
    frames = [line for line in results if line["type"] == "frame"]
    report = results[-1]
    assert report["last"] is True
    assert report["malformed"] == {"not JSON": 1}
    assert len(frames) + report["frames"]["dropped"] == count
    assert all(frame["latency_s"] >= 0.0 for frame in frames)
    assert re.search(r"warning: 127\.0\.0\.1:\d+\s+line 1: ", output)
    assert "malformed: 1 line, not JSON" in output
    assert "latency of complete frames" in output


def test_output_goes_to_several_places_and_a_stalled_one_stops_nothing(folder, lines):
    """Two consumers connect: one receives the lines of stdout, the other never reads."""
    with subprocess.Popen(
        stream(folder, "--clock", "messages", "--output", "stdout", "tcp://:0", "--queue-lines", "1000"),
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT,
    ) as process:  # fmt: skip
        assert process.stdin is not None
        assert process.stderr is not None
        ready = process.stderr.readline().decode()
        address = re.search(r"writing to tcp://127\.0\.0\.1:(\d+)", ready)
        assert address, ready + process.stderr.read().decode()
        place = ("127.0.0.1", int(address[1]))
        with socket.create_connection(place) as reader, socket.create_connection(place), reader.makefile("rb") as file:
            results: list[bytes] = []
            reading = threading.Thread(target=lambda: results.extend(_lines(process)), daemon=True)
            reading.start()
            first = file.readline()
            process.stdin.write(lines)
            process.stdin.close()
            sent = [first, *file]
        reading.join(60)
        output = process.stderr.read().decode()
        assert process.wait(60) == 0
    assert json.loads(first)["type"] == "start"
    assert sent == results
    assert re.search(rf"tcp://127\.0\.0\.1:{address[1]}: \d+ lines sent, \d+ dropped", output)


def test_stream_without_valid_lines_fails(folder):
    done = subprocess.run(stream(folder), input=b"{\n" * 9, capture_output=True, check=False, env=ENVIRONMENT)
    assert done.returncode == 1
    output = " ".join(done.stderr.decode().split())
    assert "warning: line 1: " in output
    assert "malformed: 9 lines, not JSON" in output
    assert "No line of the input was valid." in output


def _lines(process: subprocess.Popen) -> Iterator[bytes]:
    assert process.stdout is not None
    return iter(process.stdout.readline, b"")


@pytest.mark.parametrize(
    ("more", "code", "message"),
    [
        ((), 2, "--skeleton is required"),
        (("--skeleton", "body_20", "--input", "tcp://"), 2, "the port is missing"),
        (("--skeleton", "body_20", "--output", "zmq+push://"), 2, "--output zmq+push://: the port is missing"),
        (("--skeleton", "body_20", "--max-wait-s", "-1"), 2, "--max-wait-s must be a finite number above 0"),
        (("--skeleton", "fly_38", "--noise.cameras", "x", "--noise.scale-px", "1"), 2, "noise.cameras has no scale"),
    ],
)
def test_invalid_arguments_are_reported(run, folder, more, code, message):
    actual = run("stream", "--calibration", folder / "calibration.toml", *more)
    assert actual[0] == code
    assert message in actual[2]
    assert actual[1] == ""


def test_replay_needs_times(run, tmp_path):
    path = tmp_path / "rec"
    path.mkdir()
    made = posefuse.simulate_crowd(CrowdOptions(people=1, cameras=3, duration_s=1.0))
    anipose.write(made.rig, path / "calibration.toml")
    tracks = np.zeros((3, 4, 20, 3))
    np.savez(path / "keypoints.npz", keypoints=tracks[..., :2], confidence=tracks[..., 2], names=made.rig.names)
    code, out, wrong = run("replay", path, "--skeleton", "body_20")
    assert (code, out) == (1, "")
    assert "--rate-hz" in wrong
