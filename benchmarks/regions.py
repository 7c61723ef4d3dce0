"""Measure how often the 68 and 95 % regions of every layer contain the true points.

``python -m benchmarks.regions [--only walk,crowd,...] [--seeds N] [--first N] [--data FOLDER]``. Every recording is
reconstructed as the command does, with fitted bodies; ``causal`` is ``model`` without the smoother. Errors are white in
``walk`` and ``panoptic-60``; all others follow the measured error model, which has heavy tails and is correlated over
0.25 s.
"""

import argparse
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

import posefuse
from benchmarks import motions, panoptic
from benchmarks.animal_scenes import AnimalOptions, simulate_animals
from benchmarks.animals import scene_of
from benchmarks.short_trials import trial
from benchmarks.trajectory import DATA
from benchmarks.walking import Walk, walk
from posefuse.evaluation.consistency import consistency, normalized_squares
from posefuse.evaluation.matching import is_here, matches_of, mean_distances_m
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.reconstruction import Reconstruction, unpack_covariance
from posefuse.skeleton.skeletons import Skeleton
from posefuse.synthetic.crowd_options import CrowdFaults, CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, crowd_of_points, simulate_crowd

_GATE_M = 0.5
"""Largest mean distance of a scored body from a true one, in proportion to the body."""


@dataclass(frozen=True, eq=False)
class Case:
    """A recording with known truth.

    Attributes:
        rig: the cameras.
        detections: of all views.
        truth_m: shape (frame, person, keypoint, 3), NaN where missing.
        people: whether several people are tracked.
    """

    rig: CameraRig
    detections: Detections
    truth_m: np.ndarray
    people: Literal["one", "many"]

    @classmethod
    def of_walk(cls, data: Walk) -> "Case":
        """Return a recording of one person."""
        return cls(data.rig, data.detections, data.points_m[:, None], "one")

    @classmethod
    def of_scene(cls, scene: CrowdScene) -> "Case":
        """Return a scene of several people or animals."""
        return cls(scene.rig, scene.detections, np.asarray(scene.truth.layers["measured"].points_m), "many")


def panoptic_motion(folder: Path, seed: int, duration_s: float = 20.0) -> Case:
    """Return the motion of a real person at its frame rate, with measured errors."""
    motion = panoptic.one_person(folder)
    first = round((70.0 + duration_s * seed) * motion.rate_hz)
    points = motion.points_m[first : first + round(duration_s * motion.rate_hz)]
    faults = CrowdFaults(false_share=0.0, duplicate_share=0.0)
    return Case.of_scene(crowd_of_points(points, motion.rig, motion.skeleton, motion.rate_hz, faults=faults, seed=seed))


def cases(folder: Path) -> dict[str, Callable[[int], Case]]:
    """Return the recordings by name; their argument is the seed."""

    def crowd(**options: object) -> Callable[[int], Case]:
        return lambda seed: Case.of_scene(simulate_crowd(replace(CrowdOptions(seed=seed), **options)))

    def animals(name: str) -> Callable[[int], Case]:
        return lambda seed: Case.of_scene(scene_of(name, seed))

    def short(duration_s: float) -> Callable[[int], Case]:
        return lambda seed: Case.of_walk(trial("walk", duration_s, 4, 100 + seed))

    fly = AnimalOptions("still", 1, 5, 6.0, 100.0, arena_m=0.0125, skeleton="fly_38")
    return {
        "walk": lambda seed: Case.of_walk(walk(600, outlier_share=0.05, seed=seed)),
        "acts": lambda _: Case.of_walk(motions.acts(900)),
        "trial-0.8": short(0.8),
        "trial-1.7": short(1.7),
        "trial-3": short(3.0),
        "panoptic-60": lambda _: Case.of_walk(motions.panoptic_at_60_hz(folder, 600)),
        "panoptic": lambda seed: panoptic_motion(folder, seed),
        "panoptic-one": lambda seed: replace(panoptic_motion(folder, seed), people="one"),
        "crowd": crowd(duration_s=20.0),
        "whole": crowd(duration_s=8.0, people=1, skeleton="coco_wholebody_133"),
        "arena-2-3-30": animals("arena-2-3-30"),
        "arena-2-5-100": animals("arena-2-5-100"),
        "free-2-3-30": animals("free-2-3-30"),
        "fly": lambda seed: Case.of_scene(simulate_animals(replace(fly, seed=seed))),
    }


def layers(case: Case) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield the name of each layer, its points (frame, person, keypoint, 3) and covariances (..., 3, 3)."""
    options = posefuse.Options(people=case.people, bodies="fit")
    found = _reconstructed(case, options)
    causal = _reconstructed(case, replace(options, solve="frame", tracker=TrackerOptions(smoother="none")))
    of_layers = {**found.layers, "causal": causal.layers.get("model")}
    for name in ("measured", "solved", "causal", "model"):
        layer = of_layers.get(name)
        if layer is not None:
            yield name, np.asarray(layer.points_m[:]), unpack_covariance(np.asarray(layer.covariance_m2[:]))


def _reconstructed(case: Case, options: posefuse.Options) -> Reconstruction:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return posefuse.reconstruct(case.rig, case.detections, options)


def scored(points_m: np.ndarray, covariance_m2: np.ndarray, case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Return errors in m and their squares in units of the covariance, shape (frame, true person, keypoint)."""
    tree = case.detections.skeleton.tree
    gate_m = _GATE_M * (tree.scale if tree is not None else 1.0)
    distance = mean_distances_m(points_m, case.truth_m)
    person = matches_of(distance, is_here(points_m), is_here(case.truth_m), gate_m).person
    frames = np.arange(len(person))[:, None]
    offset = np.where((person >= 0)[..., None, None], points_m[frames, person] - case.truth_m, np.nan)
    return np.linalg.norm(offset, axis=-1), normalized_squares(offset, covariance_m2[frames, person])


def groups(skeleton: Skeleton) -> dict[str, np.ndarray]:
    """Return groups of keypoints, shape (keypoint,), bool: all, body, hands and face, or parts of the body."""
    names = skeleton.keypoints
    of = {"all": np.ones(len(names), dtype=bool)}
    if skeleton.parts:
        hands, face = np.zeros(len(names), dtype=bool), np.zeros(len(names), dtype=bool)
        for part in skeleton.parts:
            (hands if "hand" in part.name else face)[part.keypoints] = True
        tips = np.array([bool(re.search("(finger|thumb)_4$|tip", name)) for name in names]) & hands
        return {"body": ~hands & ~face, "hands": hands, "fingertips": tips, "face": face}
    patterns = {
        "head": "nose|eye|ear|head|mouth|neck",
        "arms": "shoulder|elbow|wrist",
        "legs": "hip|knee|ankle|heel|toe",
    }
    if skeleton.tree is not None and skeleton.tree.scale == 1.0:
        of |= {group: np.array([bool(re.search(p, name)) for name in names]) for group, p in patterns.items()}
    return of


HEAD = "| recording | layer | keypoints | points | median, mm | inside 68 / 95 % region |\n|---|---|---|---|---|---|"


def rows(name: str, runs: list[Case], details: bool) -> Iterator[str]:
    """Yield the rows of a recording, over all seeds."""
    errors: dict[str, list[np.ndarray]] = {}
    squares: dict[str, list[np.ndarray]] = {}
    skeleton = runs[0].detections.skeleton
    for case in runs:
        for layer, points_m, covariance_m2 in layers(case):
            of = scored(points_m, covariance_m2, case)
            for sums, values in zip((errors, squares), of, strict=True):
                sums.setdefault(layer, []).append(values.reshape(-1, len(skeleton)))
    for layer in errors:
        error, square = (np.concatenate(each[layer]) for each in (errors, squares))
        for group, members in groups(skeleton).items():
            if group == "all" or skeleton.parts or details:
                inside = consistency(square[:, members], 3)
                yield (
                    f"| {name} | {layer} | {group} | {inside.n} | {1e3 * np.nanmedian(error[:, members]):.3g} "
                    f"| {100 * inside.covered_68:.0f} / {100 * inside.covered_95:.0f} |"
                )


def main() -> None:
    """Print the table, each recording when it is complete."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", help="names of recordings, separated by commas")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--details", action="store_true", help="print groups of keypoints too")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of real recordings")
    given = parser.parse_args()
    usual = cases(given.data)
    chosen = given.only.split(",") if given.only else list(usual)
    if unknown := [name for name in chosen if name not in usual]:
        parser.error(f"no {unknown}; there are {', '.join(usual)}")
    print(HEAD, flush=True)
    for name in chosen:
        for row in rows(name, [usual[name](given.first + i) for i in range(given.seeds)], given.details):
            print(row, flush=True)


if __name__ == "__main__":
    main()
