"""Measure how often the 95 % regions of calibrations from people contain the truth.

Each trial simulates a rig of 2 to 12 cameras (:mod:`benchmarks.simulated_rigs`) and calibrates it, with lenses known or
not. Unknown lenses have principal points off the middles of their images, by 1 % of the width (standard deviation), as
real ones have. Regions are those of each camera: ellipsoids for rotation and center, intervals for focal length and
time offset.

    python -m benchmarks.people_coverage --trials 200 --log people_coverage.jsonl
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import get_args

import numpy as np
from scipy.stats import chi2

from benchmarks.calibration_recordings import CalibrationCase
from benchmarks.calibration_scores import CalibrationScore, in_true_world
from benchmarks.people_calibration import Calibrated, Start, calibrate
from benchmarks.simulated_rigs import LAYOUTS, PEOPLE, RigOptions, random_options, simulate_rig
from posefuse.calibration.joint.parameters import JointParameters, difference
from posefuse.calibration.people.views import ViewTracks
from posefuse.errors import PosefuseError
from posefuse.kernels.calibration.joint import FOCAL
from posefuse.model.cameras import CameraRig

PARAMETERS = {"rotation": slice(0, 3), "center": slice(3, 6), "focal": slice(FOCAL, FOCAL + 1), "offset": slice(6, 7)}
SMALLEST_SD = 1e-9
PRINCIPAL_SD = 0.01
"""Standard deviation of principal points of unknown lenses, relative to the width of the image."""


@dataclass(frozen=True)
class Trial:
    """Result of one trial.

    Attributes:
        levels: of each of :data:`PARAMETERS`, the probability level of the region on whose edge the truth lies, one per
            camera: at most 0.95 if the 95 % region contains it. Parameters that were given are missing.
        sds: median standard deviation of each.
        score: errors.
        left_out: names of cameras that were left out.
        cpu_s: CPU time.
    """

    levels: dict[str, list[float]]
    sds: dict[str, float]
    score: CalibrationScore
    left_out: list[str]
    cpu_s: float


def trial_options(seed: int) -> tuple[RigOptions, bool]:
    """Return the options of a trial, and whether its lenses are known."""
    focal_known = bool(seed % 2)
    return replace(random_options(seed), principal_sd=0.0 if focal_known else PRINCIPAL_SD), focal_known


def run(options: RigOptions, *, focal_known: bool, start: Start) -> Trial:
    """Simulate and calibrate one recording."""
    case = simulate_rig(options)
    found = calibrate(case, focal_known=focal_known, start=start, seed=options.seed)
    levels, sds = regions(case, found)
    return Trial(levels, sds, found.score(case), sorted(found.matched.left_out), found.cpu_s)


def regions(case: CalibrationCase, found: Calibrated) -> tuple[dict[str, list[float]], dict[str, float]]:
    """Return the levels of the regions on whose edges the truth lies, and standard deviations, by parameter."""
    joint = found.estimate.joint
    size = joint.parameters.size
    error = (joint.projection @ _errors(case, found).ravel()).reshape(-1, size)
    covariance = joint.covariance.reshape(len(error), size, len(error), size)
    levels: dict[str, list[float]] = {}
    sds: dict[str, float] = {}
    for name, part in PARAMETERS.items():
        if part.start >= size:
            continue
        blocks = [covariance[v, part, v, part] for v in range(len(error))]
        levels[name] = [level(e, block) for e, block in zip(error[:, part], blocks, strict=True)]
        sds[name] = float(np.median([np.sqrt(np.max(np.linalg.eigvalsh(block))) for block in blocks]))
    return levels, sds


def level(error: np.ndarray, covariance: np.ndarray) -> float:
    """Return the probability level of the ellipsoid through the error; directions without variance do not count."""
    values, vectors = np.linalg.eigh(covariance)
    free = values > max(SMALLEST_SD**2, 1e-9 * values.max())
    distance = np.square(vectors.T @ error)[free] / values[free]
    return float(chi2.cdf(distance.sum(), int(free.sum())))


def _errors(case: CalibrationCase, found: Calibrated) -> np.ndarray:
    """Return the difference of the estimate from the truth in the world of the estimate, shape (view, parameter)."""
    joint, matched = found.estimate.joint, found.matched
    names = [camera.name for camera in found.estimate.cameras]
    at = [case.rig.index(name) for name in names]
    truth = case.rig.select(names)
    true = in_true_world(truth, CameraRig(found.estimate.cameras))
    still = np.zeros(len(names))
    late = case.offset_s[at] - matched.offset_s
    focal = [
        np.log(camera.matrix[0, 0] / view.camera.matrix[0, 0])
        for camera, view in zip(truth.cameras, matched.views, strict=True)
    ]
    log_focal = None if joint.parameters.log_focal is None else np.array(focal)
    rotation, center = ([getattr(c, n) for c in true.cameras] for n in ("rotation", "center_m"))
    radial = (
        None if joint.parameters.radial is None else np.array([_unknown_distortion(case, m) for m in matched.views])
    )
    away = [
        (camera.matrix[:2, 2] - view.camera.matrix[:2, 2]) / view.camera.matrix[0, 0]
        for camera, view in zip(truth.cameras, matched.views, strict=True)
    ]
    principal = None if joint.parameters.principal is None else np.array(away)
    exact = JointParameters(np.stack(rotation), np.stack(center), late, still, log_focal, radial, principal)
    return difference(exact, joint.parameters)


def _unknown_distortion(case: CalibrationCase, view: ViewTracks) -> float:
    """Return the first coefficient of distortion that the lens of a view lacks."""
    true = case.rig.cameras[case.rig.index(view.camera.name)]
    return true.distortion[0] if true.distortion and not view.camera.distortion else 0.0


def coverage(levels: Sequence[Sequence[float]]) -> float:
    """Return the share of 95 % regions that contain the truth, NaN without any."""
    every = np.concatenate([np.asarray(each, dtype=float) for each in levels]) if levels else np.zeros(0)
    return float((every <= 0.95).mean()) if len(every) else float("nan")


GROUPS = {
    "layout": LAYOUTS,
    "people": PEOPLE,
    "cameras": ("2", "3-5", "6-12"),
    "lenses": ("known", "unknown"),
    "clocks": ("together", "apart"),
}


def groups_of(options: dict, *, focal_known: bool) -> set[str]:
    """Return the groups of the summary that a trial is in."""
    n = options["cameras"]
    return {
        options["layout"],
        options["people"],
        "2" if n == 2 else "3-5" if n <= 5 else "6-12",
        "known" if focal_known else "unknown",
        "together" if options["max_offset_s"] == 0.0 else "apart",
    }


def summary(log: list[dict]) -> None:
    """Print coverage, median standard deviation and accuracy of each group of trials, and of all."""
    print("| trials | n | failed | " + " | ".join(f"{name} % (sd)" for name in PARAMETERS) + " | rotation, degrees "
          "| centers, mm | focal, % | offset, frames | CPU s |")  # fmt: skip
    print("|---" * (8 + len(PARAMETERS)) + "|")
    for group in ("all", *(name for names in GROUPS.values() for name in names)):
        rows = [r for r in log if group == "all" or group in groups_of(r["options"], focal_known=r["focal_known"])]
        good = [r for r in rows if "error" not in r]
        if not good:
            continue
        cells = []
        for name in PARAMETERS:
            known = [r["levels"][name] for r in good if name in r["levels"]]
            sd = np.median([r["sds"][name] for r in good if name in r["sds"]] or [np.nan])
            cells.append(f"{100 * coverage(known):.1f} ({sd:.2g})")
        for name, factor in (("rotation_deg", 1.0), ("center_m", 1000.0), ("focal", 100.0), ("offset_frames", 1.0)):
            values = [factor * r["score"][name] for r in good if np.isfinite(r["score"][name])] or [np.nan]
            cells.append(f"{np.median(values):.2g} ({np.quantile(values, 0.9):.2g})")
        cpu = np.median([r["cpu_s"] for r in good])
        print(f"| {group} | {len(rows)} | {len(rows) - len(good)} | {' | '.join(cells)} | {cpu:.1f} |")


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="seed of the first trial")
    parser.add_argument("--start", choices=get_args(Start), default="people", help="start of the final estimate")
    parser.add_argument("--log", type=Path, default=Path("people_coverage.jsonl"), help="log; read if it exists")
    parser.add_argument("--summary", action="store_true", help="print the table of the log only")
    given = parser.parse_args()
    log = [json.loads(line) for line in given.log.read_text().splitlines()] if given.log.exists() else []
    done = {r["options"]["seed"] for r in log}
    seeds = [] if given.summary else [s for s in range(given.first, given.first + given.trials) if s not in done]
    with given.log.open("a") as file:
        for seed in seeds:
            options, focal_known = trial_options(seed)
            entry = {"options": asdict(options), "focal_known": focal_known}
            try:
                entry |= asdict(run(options, focal_known=focal_known, start=given.start))
            except PosefuseError as error:
                entry |= {"error": str(error)}
            log.append(json.loads(json.dumps(entry)))
            file.write(json.dumps(entry) + "\n")
            file.flush()
    summary(log)


if __name__ == "__main__":
    main()
