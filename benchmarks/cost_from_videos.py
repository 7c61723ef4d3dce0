"""Measure the cost of batches from videos on an object store: core-hours, GB and requests, per stage and in total.

``python -m benchmarks.cost_from_videos RECORDING [--detector mediapipe:pose] [--repeats 8 16] [--only stages,tasks]``.
RECORDING is a folder with short videos of one person and a calibration. Its videos are joined to longer ones; what an
image or a frame costs is the slope between the two numbers of copies, which leaves out what a start costs, and what is
estimated from samples. CPU time is that of all processes. Requests are those that a local S3 server counts.
``docs/cost.md`` shows the table.
"""

import argparse
import contextlib
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from tests.object_stores import CREDENTIALS, environment, make_bucket, s3_server, upload_folder

import posefuse
from benchmarks.detection import join_copies
from posefuse.batch.cluster import on_cluster
from posefuse.batch.schedulers import Scheduler, WorkerCount
from posefuse.io.videos.reader import VIDEO_ENDINGS
from posefuse.model.batch import Job, JobResult
from posefuse.model.options.detection import DetectOptions
from posefuse.model.options.options import Options
from posefuse.model.options.run import RunOptions
from posefuse.pipeline.run.recipe import Watcher

PART_BYTES = 50 * 2**20
"""Part of an upload of s3fs, which divides files of two parts or more."""
CAMERAS, RATE_HZ, LENGTH_H = 8, 60.0, 1.0 / 6.0
PER_FRAME = ("reconstruct",)
"""Stages whose cost is stated per frame of all cameras; that of the others is stated per image of one camera."""
CAMERA_HOURS = (1_000, 100_000)
TASKS = 10_000


@dataclass
class Run:
    """One run from videos.

    Attributes:
        images: number of images of all cameras.
        frames: number of frames of a camera.
        cpu_s: CPU time of each stage.
        files: size of each output file.
        input_bytes: size of the videos.
    """

    images: int
    frames: int
    cpu_s: dict[str, float] = field(default_factory=dict)
    files: dict[str, int] = field(default_factory=dict)
    input_bytes: int = 0


@dataclass
class Traffic:
    """Requests by kind, and the number of input and output files."""

    requests: Counter[str]
    inputs: int
    outputs: int


def cpu_s() -> float:
    """Return the CPU time of this process and of those that it waited for."""
    return sum(os.times()[:4])


def lengthened(recording: Path, folder: Path, repeats: int) -> int:
    """Copy a recording with videos that show the same several times, and return the number of their images."""
    shutil.copytree(recording, folder)
    images = 0
    for video in sorted(recording.rglob("*")):
        if video.suffix.lower() in VIDEO_ENDINGS and "calib" not in str(video.relative_to(recording)).lower():
            images += join_copies(video, folder / video.relative_to(recording).with_suffix(".mp4"), repeats)
    return images


def sizes(folder: Path) -> dict[str, int]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.stat().st_size for path in files}


def measured(recording: Path, place: Path, repeats: int, options: RunOptions) -> Run:
    """Run from lengthened videos, and return the CPU time of each stage."""
    images = lengthened(recording, place / f"in_{repeats}", repeats)
    found, last_s = Run(images, 0), cpu_s()

    def finished(stage: str, _: object) -> None:
        nonlocal last_s
        now_s = cpu_s()
        found.cpu_s[stage], last_s = now_s - last_s, now_s

    outcome = posefuse.run(
        place / f"in_{repeats}", place / f"out_{repeats}", options, Options(people="one"),
        watcher=Watcher(finished=finished),
    )  # fmt: skip
    assert outcome.reconstruction is not None
    found.frames = outcome.reconstruction.open().n_frames
    found.files = sizes(outcome.output)
    videos = {name: size for name, size in sizes(place / f"in_{repeats}").items() if "calib" not in name.lower()}
    found.input_bytes = sum(videos.values())
    return found


def slopes(short: Run, long: Run) -> tuple[dict[str, float], dict[str, float], float]:
    """Return milliseconds per image or frame and seconds per run of each stage, and bytes of video per image."""
    per_unit, fixed = {}, {}
    for stage in long.cpu_s:
        units = (short.frames, long.frames) if stage in PER_FRAME else (short.images, long.images)
        slope_s = (long.cpu_s[stage] - short.cpu_s.get(stage, 0.0)) / (units[1] - units[0])
        per_unit[stage], fixed[stage] = 1e3 * slope_s, short.cpu_s.get(stage, 0.0) - slope_s * units[0]
    return per_unit, fixed, long.input_bytes / long.images


def count_requests(recording: Path, flags: list[str]) -> Traffic:
    """Run a batch of one recording on a local S3 server, and count the requests."""
    with tempfile.TemporaryDirectory() as place:
        log = Path(place) / "log"
        with s3_server(log) as address, environment(AWS_ENDPOINT_URL=address, **CREDENTIALS):
            bucket = make_bucket("cost")
            upload_folder(recording, f"{bucket}/in/take")
            before = len(log.read_text().splitlines())
            command = ["batch", f"{bucket}/in/take", "-o", f"{bucket}/out", "--jobs", "1", "--from-videos", *flags]
            subprocess.run([sys.executable, "-m", "posefuse", *command], check=True, capture_output=True)
            lines = [line.partition('"')[2] for line in log.read_text().splitlines()[before:]]
            from posefuse.io.object_stores import list_files

            outputs = len(list_files(f"{bucket}/out/take"))
    kinds = Counter(
        "LIST" if "?list-type" in line else next((m for m in ("PUT", "GET", "HEAD", "DELETE", "POST") if m in line), "")
        for line in lines
    )
    return Traffic(kinds, len(sizes(recording)), outputs)


def _is_of_cameras(name: str) -> bool:
    """Return whether a file grows with the number of cameras: keypoints, and the videos of the report."""
    return name.startswith(("keypoints/", "report"))


def put_requests(size: float) -> int:
    """Return the number of requests of an upload."""
    return 1 if size < 2 * PART_BYTES else math.ceil(size / PART_BYTES) + 2


def nothing(job: Job) -> JobResult:
    """Do a job that does nothing."""
    return JobResult(job.name, "done")


def show_tasks() -> None:
    jobs = [Job(f"job_{i}", Path("a"), Path("b"), None, Options()) for i in range(TASKS)]
    begun_s, begun_cpu_s = time.monotonic(), time.process_time()
    done = sum(1 for _ in on_cluster(nothing, jobs, Scheduler("local", WorkerCount(2, 2))))
    spent_s = time.process_time() - begun_cpu_s
    print(
        f"{done} tasks that do nothing, two workers: {time.monotonic() - begun_s:.1f} s, {1e3 * spent_s / done:.2f} ms "
        "of CPU of the calling machine and scheduler for each"
    )


def show_totals(short: Run, long: Run, traffic: Traffic, cameras: int) -> None:
    """Print the totals, extrapolated from measured stages."""
    per_unit, fixed, video_bytes = slopes(short, long)
    frames = 3600.0 * RATE_HZ * LENGTH_H
    # A report contains short videos, and has long ones in files of their own.
    growth = {
        name: (size - short.files[name]) / (long.frames - short.frames) if name in short.files else size / long.frames
        for name, size in long.files.items()
    }
    expected = {
        name: (long.files[name] + growth[name] * (frames - long.frames))
        * (CAMERAS / cameras if _is_of_cameras(name) else 1)
        for name in long.files
    }
    print(f"extrapolated: {CAMERAS} cameras at {RATE_HZ:g} Hz, recordings of {60 * LENGTH_H:g} minutes, one person")
    print(
        "camera-hours  core-hours: detect  other images  frames  starts  GB: videos  results  LIST+PUT+POST  GET+HEAD"
    )
    for hours in CAMERA_HOURS:
        recordings = hours / CAMERAS / LENGTH_H
        detect = hours * RATE_HZ * per_unit["detect"] / 1e3
        of_frames = sum(per_unit[stage] for stage in PER_FRAME)
        others = hours * RATE_HZ * (sum(per_unit.values()) - of_frames - per_unit["detect"]) / 1e3
        frame_hours = hours / CAMERAS * RATE_HZ * of_frames / 1e3
        starts = recordings * sum(fixed.values()) / 3600.0
        up = traffic.requests["LIST"] + traffic.requests["PUT"] + traffic.requests["POST"]
        up += sum(put_requests(size) - 1 for size in expected.values())
        down = traffic.requests["GET"] + traffic.requests["HEAD"] + CAMERAS - cameras
        print(
            f"{hours:12,d} {detect:19.0f} {others:13.0f} {frame_hours:7.0f} {starts:7.0f} "
            f"{hours * 3600 * RATE_HZ * video_bytes / 1e9:12.0f} {recordings * sum(expected.values()) / 1e9:8.0f} "
            f"{recordings * up:15,.0f} {recordings * down:9,.0f}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--detector", default="mediapipe:pose")
    parser.add_argument("--repeats", type=int, nargs=2, default=[8, 16])
    parser.add_argument("--only", default="stages,tasks")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    parts = chosen.only.split(",")
    if "tasks" in parts:
        show_tasks()
    if "stages" not in parts:
        return
    # Joined copies show the same motion again, which looks like a larger offset.
    options = RunOptions(max_offset_s=0.5, detect=DetectOptions(detector=chosen.detector, jobs=1))
    with tempfile.TemporaryDirectory() as made, contextlib.redirect_stderr(None):
        place = Path(made)
        # The first run may compile kernels.
        measured(chosen.recording, place, 1, options)
        short, long = (measured(chosen.recording, place, n, options) for n in chosen.repeats)
        per_unit, fixed, video_bytes = slopes(short, long)
        cameras = round(long.images / long.frames)
        print(f"measured: {cameras} cameras, {short.frames} and {long.frames} frames, {chosen.detector}")
        for stage, value in per_unit.items():
            unit = "frame" if stage in PER_FRAME else "image"
            print(f"{value:8.2f} ms of CPU per {unit}, {fixed[stage]:5.1f} s a run: {stage}")
        grown = (sum(long.files.values()) - sum(short.files.values())) / (long.frames - short.frames)
        print(f"{video_bytes:8.0f} bytes of video per image, {grown:.0f} bytes of output per frame")
        traffic = count_requests(place / "in_1", ["--detector", chosen.detector, "--people", "one"])
        print(f"requests: {dict(traffic.requests)} for {traffic.inputs} files in, {traffic.outputs} out")
        show_totals(short, long, traffic, cameras)


if __name__ == "__main__":
    main()
