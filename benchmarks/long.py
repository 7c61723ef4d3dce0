"""Time a frame and memory of the whole-trajectory solve as a recording grows: ``python -m benchmarks.long``.

A recording of each length is reconstructed range by range in a process of its own, results dropped as they come. The
walk of 26 keypoints before five cameras with 5 % gross outliers repeats itself, forth and back, so that long recordings
are cheap to make. Memory is the process's peak beyond what it held when the recording was made.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np

from benchmarks.walking import Walk, observe, walk
from posefuse.model.options import Options
from posefuse.pipeline import prepare, reconstruct_chunks
from posefuse.progress import Silent

LENGTHS = (1_000, 10_000, 100_000)
_PERIOD = 1_000


def long_walk(frames: int) -> Walk:
    """A walk of a thousand frames, forth and back, again and again; noise and outliers are new each time."""
    once = walk(_PERIOD)
    there_and_back = np.concatenate([once.points_m, once.points_m[-2:0:-1]])
    points = there_and_back[np.arange(frames) % len(there_and_back)]
    return observe(once.rig, points, np.random.default_rng(0), outlier_share=0.05)


def peak_mb() -> float:
    """Of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def run(frames: int) -> dict[str, float]:
    """One length, in this process."""
    warnings.simplefilter("ignore")
    options = Options(solve="trajectory")
    # What is compiled or read once is not counted.
    warm = walk(120, outlier_share=0.05)
    for _ in reconstruct_chunks(prepare(warm.rig, warm.detections, options, Silent()), Silent()):
        pass
    data = long_walk(frames)
    rig, detections, points = data.rig, data.detections, data.points_m
    del data
    before = peak_mb()
    start = time.process_time()
    errors, at = [], 0
    for part in reconstruct_chunks(prepare(rig, detections, options, Silent()), Silent()):
        solved = np.asarray(part.layers["solved"].points_m)[:, 0]
        errors.append(np.linalg.norm(solved - points[at : at + len(solved)], axis=-1).astype(np.float32))
        at += len(solved)
    spent = time.process_time() - start
    return {
        "frames": frames,
        "ms_per_frame": 1000 * spent / frames,
        "beyond_mb": peak_mb() - before,
        "median_mm": 1000 * float(np.nanmedian(np.concatenate(errors))),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, help="one length, in this process, as JSON")
    parser.add_argument("--lengths", default=",".join(map(str, LENGTHS)))
    given = parser.parse_args()
    if given.frames:
        print(json.dumps(run(given.frames)))
        return
    print("| frames | CPU ms a frame | memory beyond the recording, MB | median error, mm |\n|---|---|---|---|")
    for frames in given.lengths.split(","):
        command = [sys.executable, "-m", "benchmarks.long", "--frames", frames]
        done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parent.parent)
        row = json.loads(done.stdout.splitlines()[-1])
        print(
            f"| {row['frames']:,} | {row['ms_per_frame']:.2f} | {row['beyond_mb']:.0f} | {row['median_mm']:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
