"""A long recording of two people on the command line, from parquet: ``python -m benchmarks.hour --minutes 60``.

Two people walk about before eight cameras at 60 Hz, forth and back again and again; what the detector makes of it
is new in each piece and goes to a folder of tables as it comes. Then ``posefuse reconstruct`` makes all of it in a
process of its own, which is looked at ten times a second: CPU, memory, and which chunk it is at. With ``--kill`` it is
done once more, killed (SIGKILL) at a random moment, and gone on with, and the bytes of all files are compared.
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
_LOOK_S = 0.1


def write(minutes: float, skeleton: str, folder: Path) -> int:
    """The recording, streamed; how many frames it has."""
    scene = simulate_crowd(
        CrowdOptions(people=PEOPLE, cameras=CAMERAS, duration_s=60.0, rate_hz=RATE_HZ, skeleton=skeleton)
    )
    points = np.asarray(scene.truth.layers["measured"].points_m)
    everybody = np.flatnonzero(np.isfinite(points).any(axis=(2, 3)).all(axis=1))
    once = points[everybody[0] : everybody[-1] + 1]
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
class Look:
    """At a running process.

    Attributes:
        stage: ``following`` or ``chunks``.
        chunk: how many were done in that stage.
        resident_mb: its memory then.
    """

    stage: str
    chunk: int
    resident_mb: float


def start(folder: Path, output: Path) -> subprocess.Popen[bytes]:
    """The command."""
    command = [sys.executable, "-m", "posefuse", "reconstruct", str(folder), "-o", str(output)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=Path(__file__).parent.parent)


def watch(process: subprocess.Popen[bytes], output: Path) -> tuple[list[Look], float, float]:
    """Look at it until it ends: what was seen, its CPU time in s, its peak memory in MB."""
    looks: list[Look] = []
    following, last = output / CHECKPOINT_FOLDER / "tracking.part", 0
    chunks, peak_mb = 0, 0.0
    while True:
        pid, status, used = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return looks, used.ru_utime + used.ru_stime, max(peak_mb, used.ru_maxrss / 1024.0)
        changed = following.stat().st_mtime_ns if following.exists() else 0
        chunks, last = chunks + (changed != last), changed
        made = len(list((output / CHECKPOINT_FOLDER).glob("frames_*/measured_*.part")))
        stage = ("chunks", made) if made else ("following", chunks)
        text = Path(f"/proc/{process.pid}/status").read_text()
        resident = next((line for line in text.splitlines() if line.startswith("VmRSS")), None)
        if resident is not None:
            looks.append(Look(*stage, int(resident.split()[1]) / 1024.0))
        time.sleep(_LOOK_S)


def memory(looks: list[Look], frames: int, chunk_frames: int = 2048) -> dict[str, float]:
    """The most memory in the first and in the last five minutes of the recording, MB, by stage; and of files."""
    early = _EARLY_MINUTES * 60.0 * RATE_HZ / chunk_frames
    late = frames / chunk_frames - early - 1
    found = {}
    whole = -(-frames // chunk_frames)
    for stage in ("following", "chunks"):
        # After the last frame that is followed come samples and the first chunk, after the last chunk the files.
        mine = [look for look in looks if look.stage == stage and look.chunk < whole]
        for name, some in (
            ("first", [look.resident_mb for look in mine if look.chunk <= early]),
            ("last", [look.resident_mb for look in mine if look.chunk >= late]),
        ):
            found[f"{stage}_{name}_5_min_mb"] = round(max(some, default=0.0))
    files = [look.resident_mb for look in looks if look.stage == "chunks" and look.chunk >= whole]
    return {**found, "files_mb": round(max(files, default=0.0))}


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file."""
    found = {}
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        with path.open("rb") as file:
            found[path.relative_to(folder).as_posix()] = hashlib.file_digest(file, "sha256").hexdigest()
    return found


def killed_once(folder: Path, output: Path, took_s: float, whole: Path) -> dict[str, object]:
    """Kill it at a random moment, go on, and compare."""
    after_s = random.Random(0).uniform(0.2, 0.9) * took_s
    process = start(folder, output)
    try:
        process.wait(after_s)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGKILL)
        process.wait()
    kept = sorted(path.name for path in (output / CHECKPOINT_FOLDER).rglob("*.part"))
    begin = time.perf_counter()
    code = start(folder, output).wait()
    return {
        "killed_after_s": round(after_s, 1),
        "parts_kept": len(kept),
        "went_on_s": round(time.perf_counter() - begin, 1),
        "code": code,
        "same_bytes": digests(output) == digests(whole),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--skeleton", default="coco_17")
    parser.add_argument("--folder", type=Path, help="where recording and results are left; by default a temporary one")
    parser.add_argument("--kill", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary)
        frames = round(given.minutes * 60.0 * RATE_HZ)
        if not (folder / "recording").exists():
            before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
            write(given.minutes, given.skeleton, folder / "recording")
            print(f"written in {resource.getrusage(resource.RUSAGE_SELF).ru_utime - before:.0f} s of CPU", flush=True)
        begin = time.perf_counter()
        process = start(folder / "recording", folder / "whole")
        looks, cpu_s, peak_mb = watch(process, folder / "whole")
        took_s = time.perf_counter() - begin
        size = sum(path.stat().st_size for path in (folder / "whole").rglob("*") if path.is_file())
        told = {
            "frames": frames,
            "code": process.returncode,
            "cpu_s": round(cpu_s, 1),
            "cpu_ms_per_frame": round(1000.0 * cpu_s / frames, 3),
            "faster_than_real_time": round(frames / RATE_HZ / cpu_s, 2),
            "wall_s": round(took_s, 1),
            "peak_mb": round(peak_mb),
            "result_gb": round(size / 1e9, 2),
            **memory(looks, frames),
        }
        print(json.dumps(told, indent=1), flush=True)
        if given.kill:
            again = killed_once(folder / "recording", folder / "again", took_s, folder / "whole")
            print(json.dumps(again, indent=1), flush=True)


if __name__ == "__main__":
    main()
