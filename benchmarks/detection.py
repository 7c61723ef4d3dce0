"""Measure the cost of detection in videos beside a bare loop: decoding and MediaPipe, one image after the other.

``python -m benchmarks.detection VIDEOS [--repeats 4] [--jobs 1 2]`` joins copies of each video of a folder to longer
ones, and runs ``benchmarks/peers/mediapipe/run.py`` and ``posefuse detect`` in turn, on the same interpreter and models
(``posefuse detector install mediapipe``). CPU time is that of all processes. The cost of an image is the slope between
one and ``--repeats`` copies, which leaves out what a start costs. Wall times require an otherwise idle machine.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from posefuse.detection.environments import installed_python
from posefuse.detection.registry import find_detector
from posefuse.io.videos.frame_index import read_frame_index
from posefuse.io.videos.library import import_pyav
from posefuse.io.videos.reader import VIDEO_ENDINGS

LOOP = Path(__file__).parent / "peers" / "mediapipe" / "run.py"


@dataclass(frozen=True)
class Cost:
    """Cost of one run: CPU time of all processes and wall time, in s."""

    cpu_s: float
    wall_s: float


def join_copies(video: Path, target: Path, repeats: int) -> int:
    """Write a video several times in a row, without encoding it again, and return its number of images."""
    av = import_pyav()
    index = read_frame_index(video)
    with av.open(str(target), "w") as joined:
        stream, shift = None, 0
        for _ in range(repeats):
            with av.open(str(video)) as source:
                of_source = source.streams.video[0]
                stream = stream or joined.add_stream_from_template(of_source)
                step = int(index.ticks[-1] - index.ticks[0]) + int(index.ticks[1] - index.ticks[0])
                for packet in source.demux(of_source):
                    if packet.dts is not None and packet.pts is not None:
                        packet.pts, packet.dts, packet.stream = packet.pts + shift, packet.dts + shift, stream
                        joined.mux(packet)
                shift += step
    return repeats * index.n_images


def measure(command: list[str]) -> Cost:
    """Run a command and return its cost, with that of the processes it starts."""
    started = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(command)} failed")
    return Cost(usage.ru_utime + usage.ru_stime, time.monotonic() - started)


def commands(videos: Path, output: Path, jobs: list[int]) -> dict[str, list[str]]:
    """Return the compared commands by name."""
    python = installed_python(find_detector("mediapipe")[0])
    ours = [sys.executable, "-m", "posefuse", "detect", str(videos), "--detector", "mediapipe", "--overwrite"]
    each = {f"posefuse, {n} at once": [*ours, "--jobs", str(n), "--output", str(output / f"jobs{n}")] for n in jobs}
    return {"bare loop": [str(python), str(LOOP), str(videos), str(output / "loop.npz")], **each}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("videos", type=Path)
    parser.add_argument("--repeats", type=int, default=4)
    parser.add_argument("--jobs", type=int, nargs="+", default=[1, 2])
    arguments = parser.parse_args()
    files = sorted(path for path in arguments.videos.iterdir() if path.suffix.lower() in VIDEO_ENDINGS)
    costs: dict[str, list[Cost]] = {}
    counts = []
    with tempfile.TemporaryDirectory() as made:
        for repeats in (1, arguments.repeats):
            folder = Path(made) / str(repeats)
            folder.mkdir()
            counts.append(sum(join_copies(file, folder / f"{file.stem}.mp4", repeats) for file in files))
            for name, command in commands(folder, Path(made) / f"output{repeats}", arguments.jobs).items():
                costs.setdefault(name, []).append(measure(command))
    added = counts[1] - counts[0]
    print(f"{len(files)} videos, {counts[0]} and {counts[1]} images")
    slopes = {
        name: ((b.cpu_s - a.cpu_s) / added, (b.wall_s - a.wall_s) / added, a, b) for name, (a, b) in costs.items()
    }
    loop = slopes["bare loop"]
    for name, (cpu_s, wall_s, short, long) in slopes.items():
        print(
            f"{name:22s} CPU {1000 * cpu_s:6.1f} ms an image ({cpu_s / loop[0]:.3f} of the loop), start "
            f"{short.cpu_s - counts[0] * cpu_s:4.1f} s; wall {long.wall_s:6.1f} s, {1000 * wall_s:5.1f} ms an image "
            f"({loop[1] / wall_s:.2f} times faster)"
        )


if __name__ == "__main__":
    main()
