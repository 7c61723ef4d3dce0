"""Benchmark of tracking several animals in simulated scenes, with ``posefuse reconstruct`` and ``evaluate``.

``python -m benchmarks.animals [--only arena-2-5-30,...] [--seeds 10] [--first 0] [--known]``. The name of a
case states the scenario and the numbers of animals, cameras and frames per second. ``edges`` and ``list`` have 9
keypoints, with a skeleton of edges and size, or without one. Odd seeds have 2D track identities in each view, which
change and are exchanged. ``--known`` sets the number of animals.
"""

import argparse
import math
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import posefuse
from benchmarks.animal_scenes import AnimalOptions, AnimalScenario, renamed, simulate_animals
from posefuse.evaluation.paired_results import people_points
from posefuse.evaluation.people import PeopleScores, score_people
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.skeletons import Skeleton, parse_skeleton
from posefuse.synthetic.crowd_options import CrowdFaults
from posefuse.synthetic.crowds import CrowdScene

OWN_TOML = """
name = "my_mouse"
keypoints = ["nose", "ear_l", "ear_r", "neck", "back", "hip_l", "hip_r", "tail", "tail_tip"]
pairs = [["ear_l", "ear_r"], ["hip_l", "hip_r"]]
edges = [
    ["nose", "neck"], ["ear_l", "neck"], ["ear_r", "neck"], ["neck", "back"], ["back", "hip_l"], ["back", "hip_r"],
    ["back", "tail"], ["tail", "tail_tip"],
]
[tree]
size_m = 0.1
"""
"""Skeleton of a user without a body model."""
OF = {
    "nose": "snout", "ear_l": "left_ear", "ear_r": "right_ear", "neck": "spine_front", "back": "spine_middle",
    "hip_l": "left_knee", "hip_r": "right_knee", "tail": "tail_base", "tail_tip": "tail_middle",
}  # fmt: skip
CASES = (
    "arena-2-3-30", "arena-2-3-100", "arena-2-5-30", "arena-2-5-100", "arena-3-3-30", "arena-3-3-100", "arena-3-5-30",
    "arena-3-5-100", "still-2-3-30", "still-3-5-30", "free-2-3-30", "free-3-5-30", "edges-2-3-30", "edges-3-5-30",
    "list-2-3-30", "list-3-5-30", "arena-2-2-30",
)  # fmt: skip
_FRAMES = 1200


@dataclass(frozen=True)
class Run:
    """Result of tracking one scene."""

    scores: PeopleScores
    frame_ms: float
    result: Reconstruction
    scene: CrowdScene


def scene_of(case: str, seed: int) -> CrowdScene:
    """Return the options of a case by its name."""
    what, animals, cameras, rate = case.split("-")
    scenario: AnimalScenario = "still" if what == "still" else "free" if what == "free" else "arena"
    scene = simulate_animals(
        AnimalOptions(
            scenario, int(animals), int(cameras), _FRAMES / int(rate), float(rate), seed=seed,
            faults=CrowdFaults(miss_share=0.03, track_ids=bool(seed % 2)),
        )
    )  # fmt: skip
    if what == "edges":
        return renamed(scene, parse_skeleton(OWN_TOML, "my_mouse.toml"), OF)
    return renamed(scene, Skeleton("keypoints", tuple(OF)), OF) if what == "list" else scene


def follow(scene: CrowdScene, population: int | None = None) -> Run:
    """Track a scene as the command does, with or without the number of animals."""
    options = posefuse.Options(people="many", tracker=posefuse.TrackerOptions(population=population))
    start = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = posefuse.reconstruct(scene.rig, scene.detections, options)
    spent = time.process_time() - start
    data = people_points(result, scene.truth)
    return Run(score_people(data), 1e3 * spent / len(data.points_m), result, scene)


HEAD = (
    "| scene | seeds | no switch | switches | fragments | recall, % | false, % | IDF1 | longest ghost, frames "
    "| MPJPE, mm | inside 68 / 95 % region | bones vary, % | ms/frame |\n"
    "|---|---|---|---|---|---|---|---|---|---|---|---|---|"
)


def row(name: str, runs: Sequence[Run]) -> str:
    """Return one row of the table: median (worst) of the seeds."""
    of = [run.scores for run in runs]
    clear = [scores.clear[0] for scores in of]
    ghosts = [max((ghost.longest for ghost in scores.ghosts), default=0) for scores in of]
    cells = [
        name,
        str(len(runs)),
        f"{sum(each.switches == 0 for each in clear)} of {len(runs)}",
        _said([each.switches for each in clear], "{:.0f}"),
        _said([each.fragments for each in clear], "{:.0f}"),
        _said([100 * each.recall_after_entry for each in of], "{:.1f}", min),
        _said([100 * each.false_share for each in clear], "{:.1f}"),
        _said([each.identity.idf1 for each in of], "{:.3f}", min),
        _said(ghosts, "{:.0f}"),
        _said([each.mpjpe_mm for each in of], "{:.2f}"),
        " / ".join(
            _said([100 * getattr(each.nees, part) for each in of], "{:.0f}", min)
            for part in ("covered_68", "covered_95")
        ),
        _said([100 * each.bone_variation for each in of], "{:.1f}"),
        f"{np.median([run.frame_ms for run in runs]):.2f}",
    ]
    return f"| {' | '.join(cells)} |"


def _said(values: Sequence[float], form: str, worst: object = max) -> str:
    known = [value for value in values if not math.isnan(value)] or [math.nan]
    return f"{form.format(float(np.median(known)))} ({form.format((min if worst is min else max)(known))})"


def main() -> None:
    """Print the table, each row when it is complete."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default=",".join(CASES))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--known", action="store_true")
    given = parser.parse_args()
    print(HEAD, flush=True)
    for case in given.only.split(","):
        known = int(case.split("-")[1]) if given.known else None
        runs = [follow(scene_of(case, seed), known) for seed in range(given.first, given.first + given.seeds)]
        print(row(case, runs), flush=True)


if __name__ == "__main__":
    main()
