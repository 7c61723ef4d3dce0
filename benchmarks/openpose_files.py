"""Measure the time to read many OpenPose files: ``python -m benchmarks.openpose_files --frames 25000``.

A recording of four views is written, one JSON file per frame and view, as OpenPose writes them (BODY_25, one person,
some frames without), and read in a separate process, which measures wall and processor time and memory. Several lengths
show whether time is linear in frames; ``--cold`` reads files that are not in the system's cache.
"""

import json
from pathlib import Path

import numpy as np

from benchmarks.reading import Benchmark, run

_VIEWS = 4
_KEYPOINTS = 25
_EMPTY_EVERY = 50


def write(frames: int, folder: Path) -> None:
    """Write files with the names and content of OpenPose."""
    rng = np.random.default_rng(0)
    for v in range(_VIEWS):
        camera = folder / f"cam_{v}_json"
        camera.mkdir(parents=True)
        for f in range(frames):
            values = np.round(rng.uniform(0, 1, (_KEYPOINTS, 3)) * [1920, 1080, 1], 3)
            person = {"person_id": [-1], "pose_keypoints_2d": values.ravel().tolist()} | {
                f"{part}_keypoints_{kind}": [] for part in ("face", "hand_left", "hand_right") for kind in ("2d", "3d")
            }
            people = [] if f % _EMPTY_EVERY == 0 else [person]
            text = json.dumps({"version": 1.3, "people": people}, separators=(",", ":"))
            (camera / f"cam_{v}_{f:012d}_keypoints.json").write_text(text)


def read(folder: Path) -> dict[str, float]:
    """Read the recording as the command line does, with its progress bar."""
    from posefuse.cli.console import Bars
    from posefuse.io.keypoints.read import read_keypoints
    from posefuse.io.keypoints.request import Request
    from posefuse.skeleton.skeletons import find_skeleton

    found = read_keypoints(folder, Request(find_skeleton("body_25"), 30.0, progress=Bars()))
    return {"frames": found.n_frames, "files": int(found.recorded.sum())}


def line(took: dict[str, float]) -> str:
    """Return the output line of a recording."""
    return (
        f"{took['files']:.0f} files: {took['wall_s']:.1f} s, processor {took['processor_s']:.1f} s, "
        f"{took['peak_mb']:.0f} MB"
    )


if __name__ == "__main__":
    run(Benchmark("benchmarks.openpose_files", __doc__ or "", "frames", (25_000,), int, write, read, line))
