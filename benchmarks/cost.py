"""Measure the cost of a reconstruction: CPU time, memory, bytes on disk and on the network, and scaling over processes.

``python -m benchmarks.cost [--only cpu,memory,bytes,scaling] [--seconds 20]``. CPU time is that of one process with one
thread and compiled kernels for simulated people: reading, reconstructing, and writing all files of ``posefuse
reconstruct``. A formula whose terms count operations is fitted to it; ``docs/cost.md`` shows both. Wall times of the
part ``scaling`` require an otherwise idle machine.
"""

import argparse
import contextlib
import itertools
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import nnls

from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native, replay
from posefuse.io.results.write import additional_names
from posefuse.io.stream import lines_of
from posefuse.live.session import Session
from posefuse.model.options.options import Options
from posefuse.model.options.stream import StreamOptions
from posefuse.model.tracks import TrackState
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd

RATE_HZ = 60.0
SKELETONS = {17: "coco_17", 26: "halpe_26", 133: "coco_wholebody_133"}
CASES = [
    *itertools.product((1, 2, 4), (4, 8), (17,)),
    (2, 12, 17), (8, 8, 17), (2, 4, 26), (2, 8, 26), (4, 8, 26), (1, 4, 133), (1, 8, 133), (2, 8, 133),
]  # fmt: skip
"""People, cameras, keypoints."""
TERMS = ("a frame", "a person's view", "a person's keypoint", "a person's keypoint in a view")
SCALED = 8


@dataclass(frozen=True)
class Case:
    """Size of a scene (people on average) and its CPU milliseconds per frame."""

    people: float
    cameras: int
    keypoints: int
    track_ms: float
    write_ms: float

    @property
    def terms(self) -> list[float]:
        """Return the work of a frame, one number for each of :data:`TERMS`."""
        p, v, k = self.people, self.cameras, self.keypoints
        return [1.0, p * v, p * k, p * k * v]


def scene_of(people: int, cameras: int, keypoints: int, seconds: float) -> CrowdScene:
    """Simulate walking people."""
    options = CrowdOptions(
        "crowd", people=people, cameras=cameras, duration_s=seconds, rate_hz=RATE_HZ, seed=1,
        skeleton=SKELETONS[keypoints],
    )  # fmt: skip
    return simulate_crowd(options)


def recording(scene: CrowdScene, folder: Path) -> Path:
    """Write the scene as a recording."""
    folder.mkdir(parents=True, exist_ok=True)
    anipose.write(scene.rig, folder / "calibration.toml")
    native.write(scene.detections, folder / "keypoints.nc")
    return folder


def timed(people: int, cameras: int, keypoints: int, seconds: float) -> Case:
    """Return the CPU time of tracking and measuring, and of writing, in a process with compiled kernels."""
    from posefuse.io.open_recording import open_recording
    from posefuse.io.results import netcdf
    from posefuse.pipeline.measured_layer import reconstruct_chunks
    from posefuse.pipeline.reconstruct import prepare
    from posefuse.pipeline.write_outputs import write_outputs
    from posefuse.progress import Silent

    options, spent, there = Options(people="many"), (0.0, 0.0), 0.0
    for length_s in (1.0, seconds):
        scene = scene_of(people, cameras, keypoints, length_s)
        with tempfile.TemporaryDirectory() as place:
            folder, out = recording(scene, Path(place) / "in"), Path(place) / "out"
            out.mkdir()
            start_s = time.process_time()
            inputs = open_recording(folder, None, options)
            plan = prepare(inputs.rig, inputs.detections, options, Silent())
            parts = list(reconstruct_chunks(plan, Silent()))
            middle_s = time.process_time()
            netcdf.write(iter(parts), out / "reconstruction.nc")
            with contextlib.redirect_stdout(None), contextlib.redirect_stderr(None):
                write_outputs(netcdf.read_reconstruction(out / "reconstruction.nc"), out, Silent())
            spent = middle_s - start_s, time.process_time() - middle_s
            state = np.asarray(plan.subjects.tracks(0, scene.detections.n_frames).state)
            there = float((state != TrackState.ABSENT).sum(axis=1).mean())
    per_frame = 1e3 / scene.detections.n_frames
    return Case(there, cameras, keypoints, spent[0] * per_frame, spent[1] * per_frame)


def fitted(cases: list[Case]) -> np.ndarray:
    """Fit nonnegative milliseconds of each of :data:`TERMS` with the smallest relative errors."""
    took = np.array([case.track_ms + case.write_ms for case in cases])
    return nnls(np.array([case.terms for case in cases]) / took[:, None], np.ones(len(took)))[0]


def show_cpu(seconds: float) -> None:
    print(f"CPU ms per frame, {seconds:g} s at {RATE_HZ:g} Hz")
    print("people cameras keypoints   track+measure   write   both    fit")
    cases = []
    timed(*CASES[0], 1.0)
    for people, cameras, keypoints in CASES:
        cases.append(timed(people, cameras, keypoints, seconds))
        print(cases[-1], flush=True, file=sys.stderr)
    found = fitted(cases)
    for case in cases:
        both, fit = case.track_ms + case.write_ms, float(found @ case.terms)
        print(
            f"{case.people:6.1f} {case.cameras:7d} {case.keypoints:9d} {case.track_ms:15.2f} {case.write_ms:7.2f} "
            f"{both:6.2f} {fit:6.2f}"
        )
    for name, value in zip(TERMS, found, strict=True):
        print(f"{value:8.4f} ms {name}")


def peak_mb(folder: Path, out: Path) -> float:
    """Return the peak memory of ``posefuse reconstruct``."""
    code = (
        "import re, sys; from posefuse.cli.main import main\n"
        "try: main()\nexcept SystemExit: pass\n"
        "print('peak', re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1], file=sys.stderr)"
    )
    told = subprocess.run(
        [sys.executable, "-c", code, "reconstruct", str(folder), "-o", str(out), "--people", "many"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return float(told.stderr.rpartition("peak ")[2]) / 1024.0


def show_memory() -> None:
    print("peak memory of posefuse reconstruct, MB: people cameras keypoints seconds")
    for people, cameras, keypoints, seconds in (
        (2, 8, 17, 10.0),
        (2, 8, 17, 60.0),
        (4, 8, 17, 60.0),
        (1, 8, 133, 10.0),
    ):
        with tempfile.TemporaryDirectory() as place:
            folder = recording(scene_of(people, cameras, keypoints, seconds), Path(place) / "in")
            print(f"{peak_mb(folder, Path(place) / 'out'):8.0f} {people} {cameras} {keypoints} {seconds:g}", flush=True)


def show_bytes() -> None:
    people, cameras, keypoints, seconds = 2, 8, 17, 20.0
    scene = scene_of(people, cameras, keypoints, seconds)
    frames = scene.detections.n_frames
    points = float((np.asarray(scene.detections.people_counts)).sum() * keypoints)
    print(f"bytes on disk: {people} people, {cameras} cameras, {keypoints} keypoints")
    with tempfile.TemporaryDirectory() as place:
        folder, out = recording(scene, Path(place) / "in"), Path(place) / "out"
        replay.write(scene.detections, folder / "lines.jsonl")
        for name in ("keypoints.nc", "lines.jsonl"):
            print(f"{(folder / name).stat().st_size / points:8.1f} per detected keypoint: {name}")
        (folder / "lines.jsonl").unlink()
        also = itertools.chain.from_iterable(("--also", name) for name in additional_names())
        command = ["reconstruct", str(folder), "-o", str(out), "--people", "many", *also]
        subprocess.run([sys.executable, "-m", "posefuse", *command], check=True, capture_output=True)
        sizes: dict[str, int] = {}
        for file in sorted(out.rglob("*")):
            if file.is_file():
                kind = re.sub(r"person_\d+", "*", file.relative_to(out).parts[0])
                sizes[kind] = sizes.get(kind, 0) + file.stat().st_size
        for kind, size in sizes.items():
            print(f"{size / (frames * people * keypoints):8.1f} per keypoint of a person: {kind}")
    show_wire(scene)


def show_wire(scene: CrowdScene) -> None:
    lines = [line for _, line in lines_of(scene.detections)]
    session = Session(scene.rig, scene.detections.skeleton, Options(), StreamOptions(clock="messages"))
    written = []
    for line in lines:
        session.take(line, 0.0)
        while session.waiting:
            written.append(session.process_frame(time.monotonic) or b"")
    detected = np.asarray(scene.detections.people_counts).sum() * len(scene.detections.skeleton)
    there = sum(out.count(b'"id":') for out in written) * len(scene.detections.skeleton)
    line, frame = np.mean([len(each) for each in lines]), np.mean([len(each) for each in written])
    print(f"{sum(map(len, lines)) / detected:8.1f} bytes in per detected keypoint, {line:.0f} per line")
    print(f"{sum(map(len, written)) / there:8.1f} bytes out per keypoint of a person, {frame:.0f} per frame")


def batched(folders: list[Path], out: Path, *more: str) -> tuple[float, float]:
    """Return the wall and CPU time of a batch in s."""
    before, start_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    command = ["batch", *map(str, folders), "-o", str(out), "--people", "many", *more]
    subprocess.run([sys.executable, "-m", "posefuse", *command], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.monotonic() - start_s, cpu_s


def clusters(workers: tuple[int, ...]) -> Iterator[tuple[int, str]]:
    """Print the times of Dask clusters on this machine."""
    from distributed import LocalCluster

    for n in workers:
        with LocalCluster(
            n_workers=n, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50
        ) as cluster:
            yield n, cluster.scheduler_address


def show_scaling(seconds: float) -> None:
    print(f"{SCALED} recordings of {seconds:g} s, 2 people, 8 cameras, 17 keypoints; load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as place:
        root, folders = Path(place), []
        for i in range(SCALED):
            folders.append(recording(scene_of(2, 8, 17, seconds), root / f"in_{i}"))
        for jobs in (1, 2):
            wall_s, cpu_s = batched(folders, root / f"jobs_{jobs}", "--jobs", str(jobs))
            print(f"--jobs {jobs}: {wall_s:.1f} s, {cpu_s:.1f} s of CPU", flush=True)
        for n, address in clusters((1, 2, 4)):
            batched(folders[:1], root / f"warm_{n}", "--scheduler", address)
            wall_s, _ = batched(folders, root / f"dask_{n}", "--scheduler", address)
            print(f"Dask, {n} workers: {wall_s:.1f} s", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="cpu,memory,bytes,scaling")
    parser.add_argument("--seconds", type=float, default=20.0)
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    parts = {
        "cpu": lambda: show_cpu(chosen.seconds), "memory": show_memory, "bytes": show_bytes,
        "scaling": lambda: show_scaling(chosen.seconds),
    }  # fmt: skip
    for name in chosen.only.split(","):
        parts[name]()


if __name__ == "__main__":
    main()
