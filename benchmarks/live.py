"""A live stream for a long time, with everything that goes wrong: latency, memory, identities.

``python -m benchmarks.live [--minutes 30] [--rate-hz 60] [--cameras 8] [--people 4] [--real-time]``. Starts
``posefuse stream`` on a free port of loopback and sends it a simulated crowd over one TCP connection a camera, as fast
as it happens: 1 % of the messages malformed, 2 % lost, 5 % late by up to 0.1 s, a camera dead for 10 s of every
minute. Latency is counted from the earlier of the last view's arrival and the deadline, by the stream itself; that of
complete frames also from outside, from when their last view was sent to when their line is read. Identities are
compared with a run of the same frames without a fault. A quarter of a processor for the stream, about as much for the
sender. On a machine that does other work too, latencies say how long that kept the stream waiting: ``--real-time`` has
both go first.
"""

import argparse
import heapq
import os
import re
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np

from posefuse.io.calibration import anipose
from posefuse.io.stream import lines_of
from posefuse.live.session import Session
from posefuse.model.options.options import Options
from posefuse.model.options.stream import StreamOptions
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd

MALFORMED, LOST, LATE, LATE_S, DEAD_S = 0.01, 0.02, 0.05, 0.1, 10.0
SCENE_S = 30.0
NEAR_M = 0.3


class Person(msgspec.Struct):
    """What is compared of a person."""

    id: str
    status: str
    model_m: list[list[float] | None]


class Line(msgspec.Struct):
    """What is looked at of a line."""

    type: str
    time_s: float = 0.0
    complete: bool = False
    latency_s: float | None = None
    people: list[Person] = []


@dataclass
class Heard:
    """What came out of the stream."""

    frames: dict[int, dict[str, np.ndarray]] = field(default_factory=dict)
    complete_s: list[float] = field(default_factory=list)
    incomplete_s: list[float] = field(default_factory=list)
    terminate_outside_after_s: list[float] = field(default_factory=list)
    last: bytes = b""


def frame_at(number: int, frames: int) -> int:
    """To and fro through a scene: the movement never breaks off."""
    place = number % (2 * frames - 2)
    return place if place < frames else 2 * frames - 2 - place


def messages_of(scene: CrowdScene) -> list[list[tuple[bytes, bytes]]]:
    """By frame and camera, what stands before and after the time."""
    views = len(scene.rig)
    lines = [line for _, line in lines_of(scene.detections)]
    cut = [re.match(rb'(\{"camera":"[^"]*","time_s":)[^,]*(,.*\n)', line, re.DOTALL) for line in lines]
    parts = [(found[1], found[2]) for found in cut if found]
    return [parts[i : i + views] for i in range(0, len(parts), views)]


def positions(people: list[Person]) -> dict[str, np.ndarray]:
    """Where everybody is who is active: the mean of the body's points."""
    return {
        person.id: np.mean([row for row in person.model_m if row], axis=0)
        for person in people
        if person.status == "active"
    }


def clean_run(scene: CrowdScene, messages: list[list[tuple[bytes, bytes]]], numbers: range, rate_hz: float) -> Heard:
    """The same frames without a fault, not live."""
    session = Session(scene.rig, scene.detections.skeleton, Options(), StreamOptions(clock="messages"))
    decoder, heard = msgspec.json.Decoder(Line), Heard()
    for number in numbers:
        for before, after in messages[frame_at(number, len(messages))]:
            session.take(before + b"%.6f" % (number / rate_hz) + after, 0.0)
        while session.waiting:
            line = decoder.decode(session.process_frame(time.monotonic) or b"{}")
            heard.frames[round(line.time_s * rate_hz)] = positions(line.people)
    return heard


def sent(
    messages: list[list[tuple[bytes, bytes]]], n: int, rate_hz: float, seed: int
) -> Iterator[tuple[float, int, int, bytes]]:
    """When each message goes out, its frame, camera and bytes; in that order."""
    rng = np.random.default_rng(seed)
    later: list[tuple[float, int, int, bytes]] = []
    for number in range(n):
        at_s = number / rate_hz
        while later and later[0][0] <= at_s:
            yield heapq.heappop(later)
        dead = int(at_s // 60) % len(messages[0]) if at_s % 60.0 >= 60.0 - DEAD_S else -1
        for view, (before, after) in enumerate(messages[frame_at(number, len(messages))]):
            if view == dead or rng.random() < LOST:
                continue
            line = before + b"%.6f" % at_s + after
            if rng.random() < MALFORMED:
                line = line[: int(rng.integers(1, len(line) - 1))] + b"\n"
            if rng.random() < LATE:
                heapq.heappush(later, (at_s + LATE_S * rng.random(), number, view, line))
            else:
                yield at_s, number, view, line


def listen(process: subprocess.Popen, heard: Heard, last_sent_s: dict[int, float], rate_hz: float) -> None:
    """Read the stream's lines until they end."""
    decoder = msgspec.json.Decoder(Line)
    assert process.stdout is not None
    for raw in iter(process.stdout.readline, b""):
        now_s = time.monotonic()
        line = decoder.decode(raw)
        if line.type == "report":
            heard.last = raw
        if line.type != "frame" or line.latency_s is None:
            continue
        number = round(line.time_s * rate_hz)
        heard.frames[number] = positions(line.people)
        (heard.complete_s if line.complete else heard.incomplete_s).append(line.latency_s)
        if line.complete:
            heard.terminate_outside_after_s.append(now_s - last_sent_s.pop(number, now_s))


def memory_mb(process: subprocess.Popen) -> float:
    """Resident memory."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    found = re.search(r"VmRSS:\s+(\d+)", status)
    return int(found[1]) / 1024.0 if found else np.nan


def cpu_s(process: subprocess.Popen) -> float:
    """CPU time, of all threads."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def send(
    messages: list[list[tuple[bytes, bytes]]], port: int, n: int, rate_hz: float, last_sent_s: dict[int, float],
    process: subprocess.Popen,
) -> tuple[list[float], float, float]:  # fmt: skip
    """Send everything in time.

    Returns:
        Memory of the stream every ten seconds, how far behind the sender was at most, and CPU seconds of the stream
        a frame.
    """
    before_s = cpu_s(process)
    connections = [socket.create_connection(("127.0.0.1", port)) for _ in messages[0]]
    for each in connections:
        # Else the system holds a message back for up to 40 ms while the one before it is not acknowledged.
        each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    start_s, memory, next_s, behind_s = time.monotonic(), [], 0.0, 0.0
    for at_s, number, view, line in sent(messages, n, rate_hz, 1):
        now_s = time.monotonic() - start_s
        if at_s > now_s:
            time.sleep(at_s - now_s)
        behind_s = max(behind_s, now_s - at_s)
        last_sent_s[number] = time.monotonic()
        connections[view].sendall(line)
        if at_s >= next_s:
            memory.append(memory_mb(process))
            next_s += 10.0
    time.sleep(1.0)
    for each in connections:
        each.close()
    return memory, behind_s, (cpu_s(process) - before_s) / n


def agreement(clean: Heard, live: Heard) -> tuple[float, int, int, float]:
    """Share of people of the clean run who have the name they mostly have, names, people in both, and share found."""
    seen: dict[str, Counter[str]] = {}
    total = 0
    for number, people in live.frames.items():
        for name, at_m in clean.frames.get(number, {}).items():
            total += 1
            near = min(people, key=lambda other: float(np.linalg.norm(people[other] - at_m)), default=None)
            if near is not None and float(np.linalg.norm(people[near] - at_m)) < NEAR_M:
                seen.setdefault(name, Counter())[near] += 1
    found = sum(counts.total() for counts in seen.values())
    same = sum(counts.most_common(1)[0][1] for counts in seen.values())
    return (
        same / max(found, 1),
        len({n for people in live.frames.values() for n in people}),
        len(seen),
        found / max(total, 1),
    )


def shown(name: str, values: list[float]) -> str:
    if not values:
        return f"{name:36s} none"
    p50, p99, most = 1e3 * np.quantile(values, [0.5, 0.99, 1.0])
    return f"{name:36s} {len(values):7d} frames  p50 {p50:7.1f} ms  p99 {p99:7.1f} ms  most {most:7.1f} ms"


def soak(
    scene: CrowdScene, messages: list[list[tuple[bytes, bytes]]], n: int, rate_hz: float
) -> tuple[Heard, list[float], float, float]:
    """Run the stream and everything that goes wrong."""
    heard, last_sent_s = Heard(), {}
    with tempfile.TemporaryDirectory() as folder:
        calibration = Path(folder) / "calibration.toml"
        anipose.write(scene.rig, calibration)
        command = ["stream", "--calibration", str(calibration), "--skeleton", "body_20", "--input", "tcp://:0"]
        with subprocess.Popen(
            [sys.executable, "-m", "posefuse", *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            bufsize=1 << 20,
        ) as process:  # fmt: skip
            assert process.stderr is not None
            ready = process.stderr.readline().decode()
            port = re.search(r":(\d+)$", ready.strip())
            assert port, ready + process.stderr.read().decode()
            reading = threading.Thread(target=listen, args=(process, heard, last_sent_s, rate_hz))
            errors = threading.Thread(target=process.stderr.read)
            reading.start()
            errors.start()
            memory, behind_s, frame_s = send(messages, int(port[1]), n, rate_hz, last_sent_s, process)
            process.terminate()
            reading.join()
            errors.join()
            assert process.wait() == 0
    return heard, memory, behind_s, frame_s


@contextmanager
def at_once(wanted: bool) -> Iterator[None]:
    """Run as soon as there is something to do, before whatever else the machine does; so does who is started within."""
    usual_s = sys.getswitchinterval()
    sys.setswitchinterval(0.0005)
    if wanted:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    try:
        yield
    finally:
        if wanted:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        sys.setswitchinterval(usual_s)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rate-hz", type=float, default=60.0)
    parser.add_argument("--cameras", type=int, default=8)
    parser.add_argument("--people", type=int, default=4)
    parser.add_argument("--real-time", action="store_true", help="before all other work of the machine; for root")
    chosen = parser.parse_args()
    rate_hz, n = chosen.rate_hz, int(chosen.minutes * 60 * chosen.rate_hz)
    scene = simulate_crowd(
        CrowdOptions("crowd", people=chosen.people, cameras=chosen.cameras, duration_s=SCENE_S, rate_hz=rate_hz, seed=0)
    )
    messages = messages_of(scene)
    print(f"load before: {os.getloadavg()[0]:.1f}", flush=True)
    with at_once(chosen.real_time):
        live, memory, behind_s, frame_s = soak(scene, messages, n, rate_hz)
    print(f"load after: {os.getloadavg()[0]:.1f}; the sender was behind by at most {1e3 * behind_s:.0f} ms")
    print(shown("complete", live.complete_s))
    print(shown("complete, from outside", live.terminate_outside_after_s))
    print(shown("incomplete", live.incomplete_s))
    print(f"CPU time of the stream: {1e3 * frame_s:.2f} ms a frame")
    print(
        f"memory, MB, after 10 s and then every minute: {' '.join(f'{each:.0f}' for each in memory[1::6])}", flush=True
    )
    print(live.last.decode()[:900])
    clean = clean_run(scene, messages, range(n), rate_hz)
    share, names, people, found = agreement(clean, live)
    print(
        f"people of the clean run: {people}; found {100 * found:.2f} %; of these under the name they mostly have "
        f"{100 * share:.2f} %; names in the stream: {names}"
    )


if __name__ == "__main__":
    main()
