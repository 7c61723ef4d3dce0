"""Run a live stream for a long time with faulty input, and measure latency, memory and identities.

``python -m benchmarks.live [--minutes 30] [--rate-hz 60] [--cameras 8] [--people 4] [--real-time]``. Starts ``posefuse
stream`` on a free port of loopback and sends a simulated crowd in real time over one TCP connection per camera: 1 % of
the messages malformed, 2 % lost, 5 % late by up to 0.1 s, one camera silent for 10 s of every minute. The stream itself
measures latency from the last view's arrival or the deadline, whichever is earlier; for complete frames, the receiver
also measures the time from sending the last view to reading the line. Identities are compared with a fault-free run of
the same frames. The stream uses a quarter of a processor, the sender about as much. With other load on the machine,
latencies include waiting for the processor: ``--real-time`` gives both processes priority.
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

MALFORMED, LOST, LATE, LATE_S, SILENT_S = 0.01, 0.02, 0.05, 0.1, 10.0
SCENE_S = 30.0
NEAR_M = 0.3


class Person(msgspec.Struct):
    """The compared fields of a person."""

    id: str
    status: str
    model_m: list[list[float] | None]


class Line(msgspec.Struct):
    """The evaluated fields of an output line."""

    type: str
    time_s: float = 0.0
    complete: bool = False
    latency_s: float | None = None
    people: list[Person] = []


@dataclass
class StreamOutput:
    """Positions, latencies and the final report of a stream.

    Attributes:
        frames: by frame number, the positions of active people by name.
        complete_s: latencies of complete frames.
        incomplete_s: latencies of incomplete frames.
        received_s: latencies of complete frames, measured by the receiver.
        last: the last report line.
    """

    frames: dict[int, dict[str, np.ndarray]] = field(default_factory=dict)
    complete_s: list[float] = field(default_factory=list)
    incomplete_s: list[float] = field(default_factory=list)
    received_s: list[float] = field(default_factory=list)
    last: bytes = b""


def frame_at(number: int, frames: int) -> int:
    """Return the frame of a scene that is played forward and backward, so that the motion is continuous."""
    place = number % (2 * frames - 2)
    return place if place < frames else 2 * frames - 2 - place


def messages_of(scene: CrowdScene) -> list[list[tuple[bytes, bytes]]]:
    """Return, by frame and camera, the bytes of a message before and after its time."""
    views = len(scene.rig)
    lines = [line for _, line in lines_of(scene.detections)]
    cut = [re.match(rb'(\{"camera":"[^"]*","time_s":)[^,]*(,.*\n)', line, re.DOTALL) for line in lines]
    parts = [(found[1], found[2]) for found in cut if found]
    return [parts[i : i + views] for i in range(0, len(parts), views)]


def positions(people: list[Person]) -> dict[str, np.ndarray]:
    """Return the mean of the body points of every active person, by name."""
    return {
        person.id: np.mean([row for row in person.model_m if row], axis=0)
        for person in people
        if person.status == "active"
    }


def clean_run(
    scene: CrowdScene, messages: list[list[tuple[bytes, bytes]]], numbers: range, rate_hz: float
) -> StreamOutput:
    """Process the same frames without faults, offline."""
    session = Session(scene.rig, scene.detections.skeleton, Options(), StreamOptions(clock="messages"))
    decoder, output = msgspec.json.Decoder(Line), StreamOutput()
    for number in numbers:
        for before, after in messages[frame_at(number, len(messages))]:
            session.take(before + b"%.6f" % (number / rate_hz) + after, 0.0)
        while session.waiting:
            line = decoder.decode(session.process_frame(time.monotonic) or b"{}")
            output.frames[round(line.time_s * rate_hz)] = positions(line.people)
    return output


def schedule_messages(
    messages: list[list[tuple[bytes, bytes]]], n: int, rate_hz: float, seed: int
) -> Iterator[tuple[float, int, int, bytes]]:
    """Yield the sending time, frame, camera and bytes of each message, in order of time."""
    rng = np.random.default_rng(seed)
    later: list[tuple[float, int, int, bytes]] = []
    for number in range(n):
        at_s = number / rate_hz
        while later and later[0][0] <= at_s:
            yield heapq.heappop(later)
        silent = int(at_s // 60) % len(messages[0]) if at_s % 60.0 >= 60.0 - SILENT_S else -1
        for view, (before, after) in enumerate(messages[frame_at(number, len(messages))]):
            if view == silent or rng.random() < LOST:
                continue
            line = before + b"%.6f" % at_s + after
            if rng.random() < MALFORMED:
                line = line[: int(rng.integers(1, len(line) - 1))] + b"\n"
            if rng.random() < LATE:
                heapq.heappush(later, (at_s + LATE_S * rng.random(), number, view, line))
            else:
                yield at_s, number, view, line


def listen(process: subprocess.Popen, output: StreamOutput, last_sent_s: dict[int, float], rate_hz: float) -> None:
    """Read the stream's output lines until they end."""
    decoder = msgspec.json.Decoder(Line)
    assert process.stdout is not None
    for raw in iter(process.stdout.readline, b""):
        now_s = time.monotonic()
        line = decoder.decode(raw)
        if line.type == "report":
            output.last = raw
        if line.type != "frame" or line.latency_s is None:
            continue
        number = round(line.time_s * rate_hz)
        output.frames[number] = positions(line.people)
        (output.complete_s if line.complete else output.incomplete_s).append(line.latency_s)
        if line.complete:
            output.received_s.append(now_s - last_sent_s.pop(number, now_s))


def memory_mb(process: subprocess.Popen) -> float:
    """Return the resident memory of a process in MB."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    found = re.search(r"VmRSS:\s+(\d+)", status)
    return int(found[1]) / 1024.0 if found else np.nan


def cpu_s(process: subprocess.Popen) -> float:
    """Return the CPU time of all threads of a process in s."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def send(
    messages: list[list[tuple[bytes, bytes]]], port: int, n: int, rate_hz: float, last_sent_s: dict[int, float],
    process: subprocess.Popen,
) -> tuple[list[float], float, float]:  # fmt: skip
    """Send all messages at their times.

    Returns:
        Memory of the stream every ten seconds, the largest delay of the sender, and CPU time of the stream per frame.
    """
    before_s = cpu_s(process)
    connections = [socket.create_connection(("127.0.0.1", port)) for _ in messages[0]]
    for each in connections:
        # Otherwise the system delays a message by up to 40 ms while the previous one is not acknowledged.
        each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    start_s, memory, next_s, behind_s = time.monotonic(), [], 0.0, 0.0
    for at_s, number, view, line in schedule_messages(messages, n, rate_hz, 1):
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


def agreement(clean: StreamOutput, live: StreamOutput) -> tuple[float, int, int, float]:
    """Compare the identities of two runs.

    Returns:
        Share of matched people with their most frequent name, number of names, number of people of the clean run that
        were matched, and share of their positions that were matched.
    """
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


def format_latencies(name: str, values: list[float]) -> str:
    """Format the percentiles of latencies in ms."""
    if not values:
        return f"{name:36s} none"
    p50, p99, largest = 1e3 * np.quantile(values, [0.5, 0.99, 1.0])
    return f"{name:36s} {len(values):7d} frames  p50 {p50:7.1f} ms  p99 {p99:7.1f} ms  max {largest:7.1f} ms"


def run_live(
    scene: CrowdScene, messages: list[list[tuple[bytes, bytes]]], n: int, rate_hz: float
) -> tuple[StreamOutput, list[float], float, float]:
    """Run the stream with faulty input; return its output, memory, sender delay and CPU seconds per frame."""
    output, last_sent_s = StreamOutput(), {}
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
            reading = threading.Thread(target=listen, args=(process, output, last_sent_s, rate_hz))
            errors = threading.Thread(target=process.stderr.read)
            reading.start()
            errors.start()
            memory, behind_s, frame_s = send(messages, int(port[1]), n, rate_hz, last_sent_s, process)
            process.terminate()
            reading.join()
            errors.join()
            assert process.wait() == 0
    return output, memory, behind_s, frame_s


@contextmanager
def real_time_priority(enabled: bool) -> Iterator[None]:
    """Give this process, and processes started within, priority over all other load."""
    default_s = sys.getswitchinterval()
    sys.setswitchinterval(0.0005)
    if enabled:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    try:
        yield
    finally:
        if enabled:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        sys.setswitchinterval(default_s)


def main() -> None:
    """Run the benchmark and print its results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rate-hz", type=float, default=60.0)
    parser.add_argument("--cameras", type=int, default=8)
    parser.add_argument("--people", type=int, default=4)
    parser.add_argument("--real-time", action="store_true", help="run with real-time priority; requires root")
    chosen = parser.parse_args()
    rate_hz, n = chosen.rate_hz, int(chosen.minutes * 60 * chosen.rate_hz)
    scene = simulate_crowd(
        CrowdOptions("crowd", people=chosen.people, cameras=chosen.cameras, duration_s=SCENE_S, rate_hz=rate_hz, seed=0)
    )
    messages = messages_of(scene)
    print(f"load before: {os.getloadavg()[0]:.1f}", flush=True)
    with real_time_priority(chosen.real_time):
        live, memory, behind_s, frame_s = run_live(scene, messages, n, rate_hz)
    print(f"load after: {os.getloadavg()[0]:.1f}; the largest delay of the sender was {1e3 * behind_s:.0f} ms")
    print(format_latencies("complete", live.complete_s))
    print(format_latencies("complete, at the receiver", live.received_s))
    print(format_latencies("incomplete", live.incomplete_s))
    print(f"CPU time of the stream: {1e3 * frame_s:.2f} ms per frame")
    print(
        f"memory, MB, after 10 s and then every minute: {' '.join(f'{each:.0f}' for each in memory[1::6])}", flush=True
    )
    print(live.last.decode()[:900])
    clean = clean_run(scene, messages, range(n), rate_hz)
    share, names, people, found = agreement(clean, live)
    print(
        f"people of the clean run: {people}; matched: {100 * found:.2f} %; of these with their most frequent name: "
        f"{100 * share:.2f} %; names in the stream: {names}"
    )


if __name__ == "__main__":
    main()
