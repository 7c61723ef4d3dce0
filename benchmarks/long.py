"""Time a frame and memory of the whole-trajectory solve as a recording grows: ``python -m benchmarks.long``.

A recording of each length is written to a file, and read and reconstructed range by range in a process of its own,
results dropped as they come: time and memory of the whole process count. The walk of 26 keypoints before five cameras
with 5 % gross outliers goes forth and back, so that long recordings are cheap to make.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

from benchmarks.walking import observe, walk
from posefuse import read_cameras, read_detections
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.model.options import Options
from posefuse.pipeline import prepare, reconstruct_chunks
from posefuse.progress import Silent

LENGTHS = (1_000, 10_000, 100_000)
_PERIOD = 1_000
_SCORED = 10


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


def run(folder: Path) -> dict[str, float]:
    """Reconstruct a recording; what it took."""
    warnings.simplefilter("ignore")
    options = Options(solve="trajectory")
    # What is compiled or read once is not counted.
    warm = walk(120, outlier_share=0.05)
    for _ in reconstruct_chunks(prepare(warm.rig, warm.detections, options, Silent()), Silent()):
        pass
    rig, detections = read_cameras(folder / "calibration.toml"), read_detections(folder / "keypoints.nc")
    frames = detections.n_frames
    start = time.process_time()
    errors, at = [], 0
    for part in reconstruct_chunks(prepare(rig, detections, options, Silent()), Silent()):
        solved = np.asarray(part.layers["solved"].points_m)[::_SCORED, 0]
        wanted = np.arange(at, at + part.n_frames)[::_SCORED] % (2 * _PERIOD - 2)
        errors.append(np.linalg.norm(solved - truth(2 * _PERIOD - 2)[wanted], axis=-1).astype(np.float32))
        at += part.n_frames
    spent = time.process_time() - start
    return {
        "frames": frames,
        "ms_per_frame": 1000 * spent / frames,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        "median_mm": 1000 * float(np.nanmedian(np.concatenate(errors))),
    }


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
    given = parser.parse_args()
    if given.write:
        write(int(given.write[0]), Path(given.write[1]))
        return
    if given.run:
        print(json.dumps(run(given.run)))
        return
    print("| frames | CPU ms a frame | peak memory, MB | median error, mm |\n|---|---|---|---|")
    for frames in given.lengths.split(","):
        with tempfile.TemporaryDirectory() as folder:
            alone("--write", frames, folder)
            row = json.loads(alone("--run", folder).splitlines()[-1])
        print(
            f"| {row['frames']:,} | {row['ms_per_frame']:.2f} | {row['peak_mb']:.0f} | {row['median_mm']:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
