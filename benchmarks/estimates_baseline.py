"""Hold the accuracy of estimates on simulated recordings: compare it with ``estimates_baseline.json``.

``python -m benchmarks.estimates_baseline [--write]`` measures a few seeds of the benchmarks of short trials, shortened
bones, re-acquisition, people and animals. ``--write`` stores the figures.
"""

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks import animals, people, reacquisition, short_trials, shortened_bones
from benchmarks.people_baseline import shortfalls
from posefuse.model.options.tracker import TrackerOptions
from posefuse.synthetic.crowd_options import CrowdOptions, Scenario

BASELINE = Path(__file__).with_name("estimates_baseline.json")
TOLERATED = {
    "relative_to_consensus": 0.02, "knee_error_mm": 10.0, "late": 1.0, "false_frames": 10.0, "missing_frames": 5.0,
    "causal_mm": 0.5, "smoothed_mm": 0.5, "switches": 1.0, "mpjpe_mm": 0.2,
}  # fmt: skip
"""Figures and the loss that is tolerated in addition to a share of each."""
_SEEDS = (200, 201)
_BONES_START_S, _RECOVERY_S, _RATE_HZ = 0.0, 8.0, 25.0


def short_trial(activity: short_trials.Activity, duration_s: float, cameras: int) -> dict[str, float]:
    """Return the median error of ``solved`` relative to that of ``consensus``."""
    runs = []
    for seed in _SEEDS:
        data = short_trials.trial(activity, duration_s, cameras, seed)
        error = {
            name: np.nanmedian(np.linalg.norm(points - data.points_m, axis=-1))
            for name, points in short_trials.recording_layers(data)
        }
        runs.append(error["solved"] / error["consensus"])
    return {"relative_to_consensus": float(np.mean(runs))}


def short_bones() -> dict[str, float]:
    """Return the error of the knees 3 s after thighs stop to appear 20 % short."""
    at = round(_RECOVERY_S * _RATE_HZ)
    runs = [shortened_bones.errors_mm(seed, _BONES_START_S, 0.2)[0][at : at + 20] for seed in _SEEDS]
    return {"knee_error_mm": float(np.nanmean(runs))}


def reacquired(mode: str) -> dict[str, float]:
    """Return the gaps after which people are reported late, and false and missing frames."""
    outcomes = [outcome for seed in _SEEDS for _, outcome in reacquisition.run(2, mode, seed)]
    return {
        "late": float(sum(not each.in_time for each in outcomes)),
        "false_frames": float(sum(each.false for each in outcomes)),
        "missing_frames": float(sum(each.missing for each in outcomes)),
    }


def scene(scenario: Scenario, duration_s: float | None = None) -> dict[str, float]:
    """Return the errors of tracked people, causal and smoothed."""
    found = {"causal_mm": [], "smoothed_mm": []}
    for seed in _SEEDS:
        simulated = people.scene_of(CrowdOptions(scenario, duration_s=duration_s, seed=seed))
        for name, smoothed in (("causal_mm", False), ("smoothed_mm", True)):
            run = people.follow(simulated, people.tracker_for(simulated, TrackerOptions()), smoothed=smoothed)
            found[name].append(run.scores.mpjpe_mm)
    return {name: float(np.mean(values)) for name, values in found.items()}


def mice(case: str) -> dict[str, float]:
    """Return identity switches and the error of the default layer."""
    runs = [animals.follow(animals.scene_of(case, seed)).scores for seed in _SEEDS]
    switches = sum(each.clear[0].switches for each in runs)
    return {"switches": float(switches), "mpjpe_mm": float(np.mean([each.mpjpe_mm for each in runs]))}


CASES: dict[str, Callable[[], dict[str, float]]] = {
    "walk, 1.7 s, three cameras": lambda: short_trial("walk", 1.7, 3),
    "jump, 0.8 s, five cameras": lambda: short_trial("jump", 0.8, 5),
    "thighs 20 % short for 5 s": short_bones,
    **{f"re-acquisition, {mode}": lambda mode=mode: reacquired(mode) for mode in reacquisition.MODES},
    "four people cross, 20 s": lambda: scene("crowd", 20.0),
    "two people hug": lambda: scene("hug"),
    "three mice, three cameras": lambda: mice("arena-3-3-30"),
}
"""What is measured, by name."""


def measure() -> dict[str, dict[str, float]]:
    """Return the figures of all cases, printed as they are measured."""
    measured = {}
    for name, case in CASES.items():
        measured[name] = {figure: round(value, 4) for figure, value in case().items()}
        print(name, measured[name], flush=True)
    return measured


def main() -> int:
    """Measure, compare or write; return 1 if a figure is worse."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    if parser.parse_args().write:
        BASELINE.write_text(json.dumps(measure(), indent=2) + "\n", "utf-8")
        return 0
    worse = shortfalls(measure(), json.loads(BASELINE.read_text("utf-8")), TOLERATED)
    print("\n".join(worse) or "No figure is worse than the baseline.")
    return int(bool(worse))


if __name__ == "__main__":
    sys.exit(main())
