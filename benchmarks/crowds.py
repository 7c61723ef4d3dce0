"""Benchmark of crowds: CPU time per frame of the causal tracker by people and cameras, by stage, and how it grows.

``python -m benchmarks.crowds [--people 2,5,10,20,30] [--cameras 4,8,16] [--seconds 16] [--seed 0]``. Prints the tables
of docs/benchmarks.md. One thread; 25 Hz, 17 keypoints, the scenario `ten`. Only frames of the middle half of the
recording count, in which everybody is present. Growth is fitted in logarithms: time = c people^a cameras^b.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.people import follow, scene_of, tracker_for
from benchmarks.tracking_speed import with_one_thread
from posefuse.model.frames import Frame
from posefuse.model.options.tracker import TrackerOptions
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import CrowdScene
from posefuse.tracking import manage, tracker

LIMIT_MS = 12.0
"""Time per frame that 30 people in 16 cameras may take."""
STAGES = {
    "predict": (tracker, "predict"),
    "associate": (tracker, "associate"),
    "update": (tracker, "update"),
    "initiate": (manage, "promote_tracks"),
    "manage": (tracker, "manage"),
}
"""Functions of the stages; ``manage`` contains ``initiate``, which is subtracted."""
_ASSOCIATION = ("associate", "initiate")


@dataclass(frozen=True)
class Times:
    """CPU times per frame in one scene, in ms.

    Attributes:
        frame_ms: shape (frame,).
        stage_ms: by stage, shape (frame,); ``rest`` is what remains.
    """

    frame_ms: np.ndarray
    stage_ms: dict[str, np.ndarray]


class _Clock:
    """Functions replaced by ones whose CPU time is added up."""

    def __init__(self) -> None:
        self.spent_s = dict.fromkeys(STAGES, 0.0)
        self._originals: dict[str, Callable[..., Any]] = {}

    def __enter__(self) -> "_Clock":
        for name, (module, function) in STAGES.items():
            self._originals[name] = getattr(module, function)
            setattr(module, function, self._timed(name, self._originals[name]))
        return self

    def __exit__(self, *_: object) -> None:
        for name, (module, function) in STAGES.items():
            setattr(module, function, self._originals[name])

    def _timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any) -> Any:
            start = time.process_time()
            result = function(*args)
            self.spent_s[name] += time.process_time() - start
            return result

        return call


def times_of(scene: CrowdScene, *, by_stage: bool) -> Times:
    """Track all people of a scene and return the times of its middle half.

    Args:
        scene: scene to track.
        by_stage: whether to measure stages, which adds some hundredths of a millisecond.
    """
    frames = [Frame.of(scene.detections, i) for i in range(scene.detections.n_frames)]
    live, n = tracker_for(scene, TrackerOptions()), len(frames)
    frame_ms, stage_ms = np.zeros(n), {name: np.zeros(n) for name in STAGES}
    with _Clock() as clock:
        if not by_stage:
            clock.__exit__()
        for i, frame in enumerate(frames):
            before, start = dict(clock.spent_s), time.process_time()
            live.update(frame)
            frame_ms[i] = 1e3 * (time.process_time() - start)
            for name in STAGES:
                stage_ms[name][i] = 1e3 * (clock.spent_s[name] - before[name])
    stage_ms["manage"] = stage_ms["manage"] - stage_ms["initiate"]
    stage_ms["rest"] = frame_ms - sum(stage_ms.values())
    middle = slice(n // 4, n - n // 4)
    return Times(frame_ms[middle], {name: each[middle] for name, each in stage_ms.items()})


def growth_of(sizes: np.ndarray, ms: np.ndarray) -> tuple[float, float]:
    """Return the exponents of people and cameras that fit times best.

    Args:
        sizes: shape (size, 2): people and cameras.
        ms: shape (size,).
    """
    design = np.column_stack([np.ones(len(sizes)), np.log(sizes)])
    _, people, cameras = np.linalg.lstsq(design, np.log(ms), rcond=None)[0]
    return float(people), float(cameras)


def options_of(people: int, cameras: int, seconds: float, seed: int) -> CrowdOptions:
    """Return the options of a scene of a size."""
    return CrowdOptions(
        "ten", people=people, cameras=cameras, duration_s=seconds, seed=seed, skeleton="coco_17", rate_hz=25.0
    )


def print_growth(name: str, sizes: np.ndarray, ms: np.ndarray) -> None:
    """Print how times grow, over all sizes and over those with ten people or more."""
    parts = []
    for what, chosen in (("all sizes", sizes[:, 0] > 0), ("10 people or more", sizes[:, 0] >= 10)):
        if len(np.unique(sizes[chosen, 0])) > 1 and len(np.unique(sizes[chosen, 1])) > 1:
            people, cameras = growth_of(sizes[chosen], ms[chosen])
            parts.append(f"people^{people:.2f} cameras^{cameras:.2f} ({what})")
    print(f"growth of {name}: {', '.join(parts) or 'needs two numbers of people and of cameras'}")


def main() -> None:
    """Print the tables and the growth."""
    with_one_thread("benchmarks.crowds")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", default="2,5,10,20,30")
    parser.add_argument("--cameras", default="4,8,16")
    parser.add_argument("--seconds", type=float, default=16.0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    sizes = [(int(p), int(c)) for p in given.people.split(",") for c in given.cameras.split(",")]
    # Kernels are compiled or loaded.
    times_of(scene_of(options_of(2, 2, 4.0, 0)), by_stage=False)
    names = (*STAGES, "rest")
    print(f"| people, cameras | median | mean | p90 | p99 | {' | '.join(names)} | switches | MPJPE, mm |")
    print("|---" * (7 + len(names)) + "|")
    medians, linear = [], []
    for people, cameras in sizes:
        scene = scene_of(options_of(people, cameras, given.seconds, given.seed))
        whole, parts = times_of(scene, by_stage=False).frame_ms, times_of(scene, by_stage=True).stage_ms
        scores = follow(scene, tracker_for(scene, TrackerOptions())).scores
        cells = [np.median(whole), whole.mean(), *np.quantile(whole, [0.9, 0.99]), *(parts[n].mean() for n in names)]
        text = " | ".join(f"{each:.2f}" for each in cells)
        print(f"| {people}, {cameras} | {text} | {scores.clear[0].switches} | {scores.mpjpe_mm:.1f} |", flush=True)
        medians.append(np.median(whole))
        linear.append(sum(np.median(parts[name]) for name in names if name not in _ASSOCIATION))
    array = np.array(sizes)
    print_growth("the median", array, np.array(medians))
    print_growth("all stages but associate and initiate", array, np.array(linear))
    if (30, 16) in sizes:
        ms = medians[sizes.index((30, 16))]
        print(f"30 people, 16 cameras: {ms:.1f} ms (median), {LIMIT_MS - ms:+.1f} ms to the limit of {LIMIT_MS:g} ms")


if __name__ == "__main__":
    main()
