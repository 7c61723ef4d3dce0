"""Measure ``posefuse reconstruct`` on a long recording of two people, read from parquet.

``python -m benchmarks.long_recording --minutes 60``. Two people repeat a walk in front of eight cameras at 60 Hz; the
simulated detections differ in each piece and are streamed to a folder of tables. ``posefuse reconstruct`` then runs in
a separate process, whose memory and current chunk are sampled ten times a second. With ``--kill``, a second run is
killed (SIGKILL) at a random moment and resumed, and the bytes of all files are compared.
"""

import argparse
import hashlib
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from posefuse.io.calibration import anipose
from posefuse.io.files import CHECKPOINT_FOLDER
from posefuse.io.keypoints import detection_tables
from posefuse.model.detections import Detections
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import crowd_of_points, simulate_crowd

RATE_HZ, CAMERAS, PEOPLE = 60.0, 8, 2
_PIECE = 2048
_EARLY_MINUTES = 5.0
_SAMPLE_INTERVAL_S = 0.1


def write(minutes: float, skeleton: str, folder: Path) -> int:
    """Write the recording piece by piece; return its number of frames."""
    scene = simulate_crowd(
        CrowdOptions(people=PEOPLE, cameras=CAMERAS, duration_s=60.0, rate_hz=RATE_HZ, skeleton=skeleton)
    )
    points = np.asarray(scene.truth.layers["measured"].points_m)
    complete = np.flatnonzero(np.isfinite(points).any(axis=(2, 3)).all(axis=1))
    once = points[complete[0] : complete[-1] + 1]
    walk = np.concatenate([once, once[-2:0:-1]])
    frames = round(minutes * 60.0 * RATE_HZ)

    def pieces() -> Iterator[Detections]:
        for piece, start in enumerate(range(0, frames, _PIECE)):
            numbers = np.arange(start, min(start + _PIECE, frames))
            seen = crowd_of_points(
                walk[numbers % len(walk)], scene.rig, scene.detections.skeleton, RATE_HZ, seed=piece
            ).detections
            yield replace(seen, frame_numbers=numbers, time_s=np.tile(numbers[:, None] / RATE_HZ, CAMERAS))

    folder.mkdir(parents=True)
    anipose.write(scene.rig, folder / "calibration.toml")
    detection_tables.write_pieces(pieces(), folder / "keypoints")
    return frames


@dataclass(frozen=True)
class Sample:
    """State of a running process at one time.

    Attributes:
        stage: ``tracking`` or ``chunks``.
        chunk: number of chunks completed in that stage.
        resident_mb: resident memory.
    """

    stage: str
    chunk: int
    resident_mb: float


def start(folder: Path, output: Path) -> subprocess.Popen[bytes]:
    """Start ``posefuse reconstruct`` in a separate process."""
    command = [sys.executable, "-m", "posefuse", "reconstruct", str(folder), "-o", str(output)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=Path(__file__).parent.parent)


def watch(process: subprocess.Popen[bytes], output: Path) -> tuple[list[Sample], float, float]:
    """Sample a process until it ends; return the samples, its CPU time in s and its peak memory in MB."""
    samples: list[Sample] = []
    tracking_part, last = output / CHECKPOINT_FOLDER / "tracking.part", 0
    chunks, peak_mb = 0, 0.0
    while True:
        pid, status, used = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return samples, used.ru_utime + used.ru_stime, max(peak_mb, used.ru_maxrss / 1024.0)
        changed = tracking_part.stat().st_mtime_ns if tracking_part.exists() else 0
        chunks, last = chunks + (changed != last), changed
        made = len(list((output / CHECKPOINT_FOLDER).glob("frames_*/measured_*.part")))
        stage = ("chunks", made) if made else ("tracking", chunks)
        text = Path(f"/proc/{process.pid}/status").read_text()
        resident = next((line for line in text.splitlines() if line.startswith("VmRSS")), None)
        if resident is not None:
            samples.append(Sample(*stage, int(resident.split()[1]) / 1024.0))
        time.sleep(_SAMPLE_INTERVAL_S)


def peak_memory(samples: list[Sample], frames: int, chunk_frames: int = 2048) -> dict[str, float]:
    """Return peak memory in MB: per stage, in the first and last five minutes, and while files are written."""
    early = _EARLY_MINUTES * 60.0 * RATE_HZ / chunk_frames
    late = frames / chunk_frames - early - 1
    peaks = {}
    n_chunks = -(-frames // chunk_frames)
    for stage in ("tracking", "chunks"):
        # Sampling and the first chunk follow the last tracked frame; writing files follows the last chunk.
        of_stage = [sample for sample in samples if sample.stage == stage and sample.chunk < n_chunks]
        for name, values_mb in (
            ("first", [sample.resident_mb for sample in of_stage if sample.chunk <= early]),
            ("last", [sample.resident_mb for sample in of_stage if sample.chunk >= late]),
        ):
            peaks[f"{stage}_{name}_5_min_mb"] = round(max(values_mb, default=0.0))
    files = [sample.resident_mb for sample in samples if sample.stage == "chunks" and sample.chunk >= n_chunks]
    return {**peaks, "files_mb": round(max(files, default=0.0))}


def digests(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file."""
    hashes = {}
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        with path.open("rb") as file:
            hashes[path.relative_to(folder).as_posix()] = hashlib.file_digest(file, "sha256").hexdigest()
    return hashes


def run_with_kill(folder: Path, output: Path, took_s: float, whole: Path) -> dict[str, object]:
    """Kill a run at a random moment, resume it, and compare the files."""
    after_s = random.Random(0).uniform(0.2, 0.9) * took_s
    process = start(folder, output)
    try:
        process.wait(after_s)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGKILL)
        process.wait()
    parts = sorted(path.name for path in (output / CHECKPOINT_FOLDER).rglob("*.part"))
    begin = time.perf_counter()
    code = start(folder, output).wait()
    return {
        "killed_after_s": round(after_s, 1),
        "checkpoint_parts": len(parts),
        "resumed_run_s": round(time.perf_counter() - begin, 1),
        "exit_code": code,
        "same_bytes": digests(output) == digests(whole),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--skeleton", default="coco_17")
    parser.add_argument("--folder", type=Path, help="folder for the recording and the results; temporary by default")
    parser.add_argument("--kill", action="store_true", help="also kill and resume a second run")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        frames = round(arguments.minutes * 60.0 * RATE_HZ)
        if not (folder / "recording").exists():
            before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
            write(arguments.minutes, arguments.skeleton, folder / "recording")
            print(f"written in {resource.getrusage(resource.RUSAGE_SELF).ru_utime - before:.0f} s of CPU", flush=True)
        begin = time.perf_counter()
        process = start(folder / "recording", folder / "whole")
        samples, cpu_s, peak_mb = watch(process, folder / "whole")
        took_s = time.perf_counter() - begin
        size = sum(path.stat().st_size for path in (folder / "whole").rglob("*") if path.is_file())
        report = {
            "frames": frames,
            "exit_code": process.returncode,
            "cpu_s": round(cpu_s, 1),
            "cpu_ms_per_frame": round(1000.0 * cpu_s / frames, 3),
            "speed_relative_to_real_time": round(frames / RATE_HZ / cpu_s, 2),
            "wall_s": round(took_s, 1),
            "peak_mb": round(peak_mb),
            "result_gb": round(size / 1e9, 2),
            **peak_memory(samples, frames),
        }
        print(json.dumps(report, indent=1), flush=True)
        if arguments.kill:
            resumed = run_with_kill(folder / "recording", folder / "again", took_s, folder / "whole")
            print(json.dumps(resumed, indent=1), flush=True)


if __name__ == "__main__":
    main()
