"""Memory of reading a large replay of JSON lines by ranges: ``python -m benchmarks.json_replay --gigabytes 1``.

Four views (COCO-WholeBody-133, three people) of that size are written into a temporary folder, and read range by range,
a thousand frames each, in a process of its own. The same at a quarter of the length shows what of the memory grows with
it.
"""

import json
from pathlib import Path

import numpy as np

from benchmarks.parquet_replay import line, read_ranges
from benchmarks.reading import Benchmark, run

_VIEWS, _PEOPLE, _KEYPOINTS = 4, 3, 133


def write(gigabytes: float, folder: Path) -> None:
    """A replay of that size."""
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
    """Read the replay range by range."""
    return read_ranges(folder / "replay.jsonl", None)


if __name__ == "__main__":
    run(Benchmark("benchmarks.json_replay", __doc__ or "", "gigabytes", (0.25, 1.0), float, write, read, line))
