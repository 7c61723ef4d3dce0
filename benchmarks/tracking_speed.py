"""Benchmark of tracking: speed, time to the first result, and memory of a tracker after hours of frames.

``python -m benchmarks.tracking_speed [--only frames,first,memory] [--runs 5] [--minutes 60]``. Prints the tables of
docs/benchmarks.md. One thread; times per frame are CPU times after the first few frames, in scenes in which people
enter and leave. The measured layer triangulates each person's keypoints from the assigned detections, as
``reconstruct`` does by default, in one call after the last frame.
"""

import argparse
import gc
import os
import pickle
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.people import scene_of, tracker_for
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.measured_layer import measure
from posefuse.pipeline.reconstruct import prepare
from posefuse.progress import Silent
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import CrowdScene

FOUR = "4 people, 5 cameras, 20 keypoints"
SCENES = {
    FOUR: CrowdOptions("crowd", seed=0),
    "10 people, 8 cameras, 20 keypoints": CrowdOptions("ten", seed=0),
    "1 person, 5 cameras, 133 keypoints": CrowdOptions(
        "crowd", people=1, duration_s=20.0, seed=0, skeleton="coco_wholebody_133"
    ),
}
PARTS = ("frames", "first", "memory")
_WARM_FRAMES = 50
_LOOKS = 6
"""Interval between samples of the memory."""


@dataclass(frozen=True)
class Figures:
    """CPU times of one run over a scene, in ms.

    Attributes:
        median: median over frames.
        mean: mean over frames.
        p99: 99th percentile over frames.
        measured: additional time of the measured layer, per frame.
        smoothed: time of the full smoother, per person and frame.
    """

    median: float
    mean: float
    p99: float
    measured: float
    smoothed: float


def figures_of(scene: CrowdScene) -> Figures:
    """Track, measure and smooth all people once."""
    spent = 1e3 * frame_s(scene)[_WARM_FRAMES:]
    measured, smoothed = smoothing_ms(scene)
    p99 = float(np.quantile(spent, 0.99))
    return Figures(float(np.median(spent)), float(spent.mean()), p99, measured, smoothed)


def frame_s(scene: CrowdScene) -> np.ndarray:
    """Return the CPU time of each frame of a live tracker, shape (frame,)."""
    tracker = tracker_for(scene, TrackerOptions())
    spent = np.empty(scene.detections.n_frames)
    for i in range(len(spent)):
        frame = Frame.of(scene.detections, i)
        start = time.process_time()
        tracker.update(frame)
        spent[i] = time.process_time() - start
    return spent


def smoothing_ms(scene: CrowdScene) -> tuple[float, float]:
    """Return the CPU time of the measured layer per frame, and of the full smoother per person and frame."""
    plan = prepare(scene.rig, scene.detections, Options(people="many"), Silent())
    frames = plan.detections.n_frames
    start = time.process_time()
    measure(plan, 0, frames)
    between = time.process_time()
    people = [] if plan.bodies is None else plan.bodies.smoother().take(frames).bodies
    smoothed = time.process_time() - between
    return 1e3 * (between - start) / frames, 1e3 * smoothed / max(1, sum(len(each.places) for each in people))


def frames(runs: int) -> None:
    """Print times per frame: the lowest of the runs, and their median in parentheses."""
    print("| ms | median | mean | p99 | median with the measured layer | smoothing, per person and frame |")
    print("|---|---|---|---|---|---|")
    for what, options in SCENES.items():
        scene = scene_of(options)
        frame_s(scene)
        found = [figures_of(scene) for _ in range(runs)]
        columns = [[getattr(each, name) for each in found] for name in ("median", "mean", "p99")]
        columns.append([each.median + each.measured for each in found])
        columns.append([each.smoothed for each in found])
        cells = " | ".join(f"{min(column):.2f} ({statistics.median(column):.2f})" for column in columns)
        print(f"| {what} | {cells} |", flush=True)


_FIRST = """
import pickle, sys, time
import posefuse
rig, skeleton, frames = pickle.load(open(sys.argv[1], "rb"))
start = time.perf_counter()
tracker = posefuse.Tracker(rig, skeleton)
spent = []
for frame in frames:
    tracker.update(frame)
    spent.append(time.perf_counter() - start)
    start = time.perf_counter()
print(spent[0], max(spent))
"""


def first(runs: int) -> None:
    """Print the time of a new process to its first frame, with an empty and with a warm cache."""
    scene = scene_of(SCENES[FOUR])
    seen = [Frame.of(scene.detections, i) for i in range(100)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "frames.pkl"
        file.write_bytes(pickle.dumps((scene.rig, scene.detections.skeleton, seen)))
        times = [_first_s(file, Path(folder) / "cache") for _ in range(1 + runs)]
    print("| wall time, s | from the start of a process to its first result | slowest frame of the first 100 |")
    print("|---|---|---|")
    for what, some in (("empty cache", times[:1]), ("warm cache", times[1:])):
        whole, slowest = (f"{min(each):.2f} to {max(each):.2f}" for each in zip(*some, strict=True))
        print(f"| {what} | {whole} | {slowest} |", flush=True)


def _first_s(file: Path, cache: Path) -> tuple[float, float]:
    """Return the time to the first result of a process, and that of the slowest frame."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    start = time.perf_counter()
    process = subprocess.run(
        [sys.executable, "-c", _FIRST, str(file)], env=environment, check=True, capture_output=True, text=True
    )
    whole = time.perf_counter() - start
    first_s, slowest_s = (float(each) for each in process.stdout.split())
    # Later frames take the time that this prints.
    return whole if slowest_s == first_s else min(whole, whole - slowest_s + first_s), slowest_s


def memory(minutes: float) -> None:
    """Print the memory of a live tracker while a scene with people who enter and leave is repeated."""
    scene = scene_of(SCENES[FOUR])
    rate_hz = scene.detections.rate_hz or 25.0
    tracker, length = tracker_for(scene, TrackerOptions()), scene.detections.n_frames
    total = round(60.0 * minutes * rate_hz)
    print(
        "| frames | tracker pickled, kB | objects | memory of the process, MB | people so far |\n|---|---|---|---|---|"
    )
    for n in range(total):
        again, i = divmod(n, length)
        frame = Frame.of(scene.detections, i)
        tracker.update(replace(frame, time_s=frame.time_s + again * length / rate_hz, number=n))
        if (n + 1) % max(1, total // _LOOKS) == 0:
            gc.collect()
            kb = len(pickle.dumps(tracker)) / 1e3
            print(
                f"| {n + 1} | {kb:.0f} | {len(gc.get_objects())} | {_resident_mb():.0f} | "
                f"{tracker.confirmed.n_created} |",
                flush=True,
            )


def _resident_mb() -> float:
    """Return the memory of this process in MB, NaN if unknown."""
    file = Path("/proc/self/statm")
    return int(file.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6 if file.exists() else float("nan")


def with_one_thread(module: str) -> None:
    """Restart a benchmark with one NumPy thread: waiting threads spin, which would count as CPU time."""
    alone = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    if not alone.items() <= os.environ.items():
        command = [sys.executable, "-m", module, *sys.argv[1:]]
        os.execve(sys.executable, command, {**os.environ, **alone})


def main() -> None:
    """Run all parts of the benchmark, or the selected ones."""
    with_one_thread("benchmarks.tracking_speed")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default=",".join(PARTS))
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--minutes", type=float, default=60.0)
    chosen = parser.parse_args()
    only = chosen.only.split(",")
    unknown = sorted(set(only) - set(PARTS))
    if unknown:
        parser.error(f"no {unknown}; there are {', '.join(PARTS)}")
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    if "frames" in only:
        frames(chosen.runs)
    if "first" in only:
        first(chosen.runs)
    if "memory" in only:
        memory(chosen.minutes)


if __name__ == "__main__":
    main()
