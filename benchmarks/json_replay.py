"""Measure the memory of reading a large replay of JSON lines in ranges of frames.

``python -m benchmarks.json_replay --gigabytes 1``. A recording of that size (four views, COCO-WholeBody-133, three
people) is written to a temporary folder and read in ranges of a thousand frames in a separate process. A second
recording of a quarter of the length shows how memory grows with the length.
"""

import json
from pathlib import Path

import numpy as np

from benchmarks.parquet_replay import line, read_ranges
from benchmarks.reading import Benchmark, run

_VIEWS, _PEOPLE, _KEYPOINTS = 4, 3, 133


def write(gigabytes: float, folder: Path) -> None:
    """Write a replay of that size."""
    rng = np.random.default_rng(0)
    folder.mkdir(parents=True)
    names = [f"cam_{v}" for v in range(_VIEWS)]
    head = {"replay": 1, "cameras": names, "skeleton": "coco_wholebody_133", "rate_hz": 25.0}
    with (folder / "replay.jsonl").open("w") as file:
        file.write(json.dumps(head) + "\n")
        number = 0
        while file.tell() < gigabytes * 1e9:
            people = np.round(rng.uniform(0, 1920, (_VIEWS, _PEOPLE, _KEYPOINTS, 3)), 2).tolist()
            cameras = {
                name: {"time_s": number / 25, "detections": [{"keypoints": keypoints} for keypoints in seen]}
                for name, seen in zip(names, people, strict=True)
            }
            file.write(json.dumps({"frame": number, "cameras": cameras}) + "\n")
            number += 1


def read(folder: Path) -> dict[str, float]:
    """Read the replay in ranges."""
    return read_ranges(folder / "replay.jsonl", None)


if __name__ == "__main__":
    run(Benchmark("benchmarks.json_replay", __doc__ or "", "gigabytes", (0.25, 1.0), float, write, read, line))
