"""Measure time per frame and memory of the trajectory solve for recordings of increasing length.

``python -m benchmarks.long_trajectory``. A recording of each length is written to a file. A separate process reads and
reconstructs it range by range, discards the results, and measures its time and memory. The working memory of the solver
is the peak minus the memory of the program, of the loaded part of the recording, and of results. ``--in-memory`` uses
one call of ``reconstruct``. The walk of 26 keypoints in front of five cameras with 5 % gross outliers repeats forward
and backward, so that long recordings are cheap to simulate.
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
    "frames", "CPU ms per frame", "peak, MB", "program", "input", "output", "working memory",
    "median error, mm",
)  # fmt: skip


def truth(frames: int) -> np.ndarray:
    """Return a walk of a thousand frames, repeated forward and backward, shape (frame, keypoint, 3)."""
    once = walk(_PERIOD).points_m
    there_and_back = np.concatenate([once, once[-2:0:-1]])
    return there_and_back[np.arange(frames) % len(there_and_back)]


def write(frames: int, folder: Path) -> None:
    """Write the recording; noise and outliers differ in each repetition of the walk."""
    rig = walk(1).rig
    data = observe(rig, truth(frames), np.random.default_rng(0), outlier_share=0.05)
    anipose.write(rig, folder / "calibration.toml")
    native.write(data.detections, folder / "keypoints.nc")


def run(folder: Path, *, in_memory: bool = False) -> dict[str, float]:
    """Reconstruct a recording and return its time, memory and error.

    Args:
        folder: folder of the recording.
        in_memory: use one call with all data in memory instead of ranges of the file.
    """
    warnings.simplefilter("ignore")
    options = Options(solve="trajectory")
    # Compiling and loading happen once and are not measured.
    warm = walk(120, outlier_share=0.05)
    for _ in reconstruct_chunks(prepare(warm.rig, warm.detections, options, Silent()), Silent()):
        pass
    program_mb = resident_mb("VmRSS")
    rig, detections = read_cameras(folder / "calibration.toml"), read_detections(folder / "keypoints.nc")
    if in_memory:
        detections = detections.frames(0, detections.n_frames)
    reset_peak()
    frames, errors, output_mb = detections.n_frames, [], 0.0
    start = time.process_time()
    if in_memory:
        result = reconstruct(rig, detections, options)
        output_mb = layers_mb(result)
        errors.append(errors_mm(result, 0))
    else:
        at = 0
        for part in reconstruct_chunks(prepare(rig, detections, options, Silent()), Silent()):
            errors.append(errors_mm(part, at))
            at += part.n_frames
    spent, peak_mb, loaded_mb = time.process_time() - start, resident_mb("VmHWM"), input_mb(detections)
    return {
        "frames": frames,
        "ms_per_frame": 1000 * spent / frames,
        "peak_mb": peak_mb,
        "program_mb": program_mb,
        "loaded_mb": loaded_mb,
        "output_mb": output_mb,
        "working_mb": peak_mb - program_mb - loaded_mb - output_mb,
        "median_mm": float(np.nanmedian(np.concatenate(errors))),
    }


def errors_mm(part: Reconstruction, at: int) -> np.ndarray:
    """Return the errors of every tenth frame of a range that starts at ``at``, in mm."""
    solved = np.asarray(part.layers["solved"].points_m)[::_SCORED, 0]
    frames = np.arange(at, at + part.n_frames)[::_SCORED] % (2 * _PERIOD - 2)
    return 1000 * np.linalg.norm(solved - truth(2 * _PERIOD - 2)[frames], axis=-1).astype(np.float32)


def input_mb(detections: Detections) -> float:
    """Return the size of the detections' arrays in memory in MB; for a file, those of its times and index."""
    arrays = (getattr(detections, each.name) for each in fields(detections))
    return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray)) / 2.0**20


def layers_mb(result: Reconstruction) -> float:
    """Return the size of a result's layers in MB."""
    arrays = (getattr(layer, each.name) for layer in result.layers.values() for each in fields(layer))
    return sum(array.nbytes for array in arrays) / 2.0**20


def resident_mb(what: str) -> float:
    """Return the memory of this process in MB: ``VmRSS`` is the current value, ``VmHWM`` the peak."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith(what)).split()[1]) / 1024.0


def reset_peak() -> None:
    """Reset the peak ``VmHWM``."""
    Path("/proc/self/clear_refs").write_text("5")


def run_separately(*arguments: str) -> str:
    """Run this module in a separate process and return its output."""
    command = [sys.executable, "-m", "benchmarks.long_trajectory", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parent.parent)
    return done.stdout


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lengths", default=",".join(map(str, LENGTHS)))
    parser.add_argument("--write", nargs=2, metavar=("FRAMES", "FOLDER"), help="write one recording")
    parser.add_argument("--run", type=Path, metavar="FOLDER", help="reconstruct one recording and print JSON")
    parser.add_argument("--in-memory", action="store_true", help="use one call with all data in memory")
    arguments = parser.parse_args()
    if arguments.write:
        write(int(arguments.write[0]), Path(arguments.write[1]))
        return
    if arguments.run:
        print(json.dumps(run(arguments.run, in_memory=arguments.in_memory)))
        return
    print(f"| {' | '.join(HEADING)} |\n{'|---' * len(HEADING)}|")
    for frames in arguments.lengths.split(","):
        with tempfile.TemporaryDirectory() as folder:
            run_separately("--write", frames, folder)
            how = ("--in-memory",) if arguments.in_memory else ()
            row = json.loads(run_separately("--run", folder, *how).splitlines()[-1])
        memory = (f"{row[name]:.0f}" for name in ("peak_mb", "program_mb", "loaded_mb", "output_mb", "working_mb"))
        print(
            f"| {row['frames']:,} | {row['ms_per_frame']:.2f} | {' | '.join(memory)} | {row['median_mm']:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
