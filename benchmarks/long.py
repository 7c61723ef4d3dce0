"""Time a frame and memory of the whole-trajectory solve as a recording grows: ``python -m benchmarks.long``.

A recording of each length is written to a file, and read and reconstructed range by range in a process of its own,
results dropped as they come: time and memory of the whole process count, and the solver's own working memory is what
is left of the peak without the program, what it holds of the recording, and results. ``--in-memory`` does it in one
call of ``reconstruct``. The walk of 26 keypoints before five cameras
with 5 % gross outliers goes forth and back, so that long recordings are cheap to make.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
import warnings
from dataclasses import fields
from pathlib import Path

import numpy as np

from benchmarks.walking import observe, walk
from posefuse import read_cameras, read_detections, reconstruct
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.measured_layer import reconstruct_chunks
from posefuse.pipeline.reconstruct import prepare
from posefuse.progress import Silent

LENGTHS = (1_000, 10_000, 100_000)
_PERIOD = 1_000
_SCORED = 10
HEADING = (
    "frames", "CPU ms a frame", "peak, MB", "the program itself", "what it was given", "what it gave", "its own work",
    "median error, mm",
)  # fmt: skip


def truth(frames: int) -> np.ndarray:
    """Shape (frame, keypoint, 3): a walk of a thousand frames, forth and back, again and again."""
    once = walk(_PERIOD).points_m
    there_and_back = np.concatenate([once, once[-2:0:-1]])
    return there_and_back[np.arange(frames) % len(there_and_back)]


def write(frames: int, folder: Path) -> None:
    """The recording; noise and outliers are new each time the walk comes again."""
    rig = walk(1).rig
    data = observe(rig, truth(frames), np.random.default_rng(0), outlier_share=0.05)
    anipose.write(rig, folder / "calibration.toml")
    native.write(data.detections, folder / "keypoints.nc")


def run(folder: Path, *, in_memory: bool = False) -> dict[str, float]:
    """Reconstruct a recording; what it took.

    Args:
        folder: with the recording.
        in_memory: as one call that takes and gives everything in memory, not range by range from the file.
    """
    warnings.simplefilter("ignore")
    options = Options(solve="trajectory")
    # What is compiled or read once is not counted.
    warm = walk(120, outlier_share=0.05)
    for _ in reconstruct_chunks(prepare(warm.rig, warm.detections, options, Silent()), Silent()):
        pass
    before_mb = resident_mb("VmRSS")
    rig, detections = read_cameras(folder / "calibration.toml"), read_detections(folder / "keypoints.nc")
    if in_memory:
        detections = detections.frames(0, detections.n_frames)
    forget_peak()
    frames, errors, given_mb = detections.n_frames, [], 0.0
    start = time.process_time()
    if in_memory:
        result = reconstruct(rig, detections, options)
        given_mb = layers_mb(result)
        errors.append(off_mm(result, 0))
    else:
        at = 0
        for part in reconstruct_chunks(prepare(rig, detections, options, Silent()), Silent()):
            errors.append(off_mm(part, at))
            at += part.n_frames
    spent, peak_mb, taken_mb = time.process_time() - start, resident_mb("VmHWM"), taken_by(detections)
    return {
        "frames": frames,
        "ms_per_frame": 1000 * spent / frames,
        "peak_mb": peak_mb,
        "before_mb": before_mb,
        "taken_mb": taken_mb,
        "given_mb": given_mb,
        "own_mb": peak_mb - before_mb - taken_mb - given_mb,
        "median_mm": float(np.nanmedian(np.concatenate(errors))),
    }


def off_mm(part: Reconstruction, at: int) -> np.ndarray:
    """How far every tenth frame of a range from ``at`` on is from the truth."""
    solved = np.asarray(part.layers["solved"].points_m)[::_SCORED, 0]
    wanted = np.arange(at, at + part.n_frames)[::_SCORED] % (2 * _PERIOD - 2)
    return 1000 * np.linalg.norm(solved - truth(2 * _PERIOD - 2)[wanted], axis=-1).astype(np.float32)


def taken_by(detections: Detections) -> float:
    """MB of the detections' arrays that are in memory: of a file its times and where each frame's people are."""
    arrays = (getattr(detections, each.name) for each in fields(detections))
    return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray)) / 2.0**20


def layers_mb(result: Reconstruction) -> float:
    """MB of a result's layers."""
    arrays = (getattr(layer, each.name) for layer in result.layers.values() for each in fields(layer))
    return sum(array.nbytes for array in arrays) / 2.0**20


def resident_mb(what: str) -> float:
    """Memory of this process, as Linux counts it: ``VmRSS`` now, ``VmHWM`` at most."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith(what)).split()[1]) / 1024.0


def forget_peak() -> None:
    """Reset the peak ``VmHWM``."""
    Path("/proc/self/clear_refs").write_text("5")


def alone(*arguments: str) -> str:
    """What this module prints in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.long", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parent.parent)
    return done.stdout


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lengths", default=",".join(map(str, LENGTHS)))
    parser.add_argument("--write", nargs=2, metavar=("FRAMES", "FOLDER"), help="one recording")
    parser.add_argument("--run", type=Path, metavar="FOLDER", help="that recording, as JSON")
    parser.add_argument("--in-memory", action="store_true", help="as one call, nothing in files")
    given = parser.parse_args()
    if given.write:
        write(int(given.write[0]), Path(given.write[1]))
        return
    if given.run:
        print(json.dumps(run(given.run, in_memory=given.in_memory)))
        return
    print(f"| {' | '.join(HEADING)} |\n{'|---' * len(HEADING)}|")
    for frames in given.lengths.split(","):
        with tempfile.TemporaryDirectory() as folder:
            alone("--write", frames, folder)
            how = ("--in-memory",) if given.in_memory else ()
            row = json.loads(alone("--run", folder, *how).splitlines()[-1])
        memory = (f"{row[name]:.0f}" for name in ("peak_mb", "before_mb", "taken_mb", "given_mb", "own_mb"))
        print(
            f"| {row['frames']:,} | {row['ms_per_frame']:.2f} | {' | '.join(memory)} | {row['median_mm']:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
