"""Measure accuracy relative to the oracle, and compare it with the baseline.

The oracle is the maximum-likelihood point of the true inliers, found by SciPy through the whole lens model with the
true noise. ``python -m benchmarks.accuracy`` measures, prints and compares with ``baseline.json``; ``--update``
replaces it.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from tests.reference.points import maximum_likelihood_point

from benchmarks.trajectory import solved
from benchmarks.walking import SIGMA_PX, Walk, walk
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer, unpack_covariance
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.synthetic.options import LensKind

BASELINE = Path(__file__).with_name("baseline.json")
METHODS = ("simple", "consensus")
LENSES: tuple[LensKind, ...] = ("pinhole", "barrel", "fisheye")
TRAJECTORY = "trajectory pinhole"
OUTLIER_SHARE = 0.05
PROMISED = {"simple pinhole": 1.01, "consensus pinhole": 1.01, TRAJECTORY: 0.44}
"""Maximum median error relative to the per-frame oracle, which uses neither time nor bones; 1.03 for other cases."""
REGION_68, REGION_95 = 3.5059, 7.8147


def oracle_points(data: Walk) -> np.ndarray:
    """Return the best points without prior knowledge, shape (frame, keypoint, 3); NaN below two inliers."""
    points = np.full(data.points_m.shape, np.nan)
    for f, k in np.ndindex(points.shape[:2]):
        views = np.flatnonzero(data.inlier[f, :, k])
        if len(views) >= 2:
            cameras = [data.rig.cameras[v] for v in views]
            sigma = np.full(len(views), SIGMA_PX)
            points[f, k], _ = maximum_likelihood_point(cameras, data.pixels[f, views, k], sigma, data.points_m[f, k])
    return points


def against_oracle(methods: tuple[str, ...], lens: LensKind, frames: int) -> dict[str, dict[str, float]]:
    """Return the median and 99 % errors of methods relative to the oracle's, on the same points."""
    data = walk(frames, lens=lens)
    oracle = np.linalg.norm(oracle_points(data) - data.points_m, axis=-1)
    found = {}
    for method in methods:
        points = reconstruct(data.rig, data.detections, options_of(method)).layers["measured"].points_m[:, 0]
        found[method] = _shares(np.linalg.norm(points - data.points_m, axis=-1), oracle)
    return found


def _shares(ours: np.ndarray, oracle: np.ndarray) -> dict[str, float]:
    errors = ours, oracle
    medians = [float(np.median(error)) for error in errors]
    tails = [float(np.percentile(error, 99)) for error in errors]
    return {
        "median_mm": 1000 * medians[0],
        "median_of_oracle": medians[0] / medians[1],
        "p99_of_oracle": tails[0] / tails[1],
    }


def options_of(method: str) -> Options:
    """Return default options with this triangulation method."""
    return Options(pairs="labels", solve="frame", triangulation=TriangulationOptions(method=method))


def coverage(method: str, lens: LensKind, frames: int) -> dict[str, float]:
    """Return the share of points inside the 68 and 95 % regions of their covariance, with estimated noise."""
    data = walk(frames, lens=lens, seed=1)
    layer = reconstruct(data.rig, data.detections, options_of(method)).layers["measured"]
    return _covered(layer.points_m[:, 0] - data.points_m, layer)


def _covered(offset: np.ndarray, layer: Layer) -> dict[str, float]:
    squared = np.einsum("fki,fkij,fkj->fk", offset, np.linalg.inv(unpack_covariance(layer.covariance_m2[:, 0])), offset)
    return {"covered_68": float((squared < REGION_68).mean()), "covered_95": float((squared < REGION_95).mean())}


def whole_trajectory(oracle_frames: int, coverage_frames: int) -> dict[str, float]:
    """Compare the trajectory solve with the per-frame oracle on its middle frames, and measure its coverage."""
    data = walk(coverage_frames, outlier_share=OUTLIER_SHARE, seed=1)
    layer = solved(data.rig, data.detections)
    offset = np.asarray(layer.points_m)[:, 0] - data.points_m
    middle = slice(coverage_frames // 2, coverage_frames // 2 + oracle_frames)
    best = np.linalg.norm(oracle_points(data.between(middle)) - data.points_m[middle], axis=-1)
    return _shares(np.linalg.norm(offset[middle], axis=-1), best) | _covered(offset, layer)


def measure(
    oracle_frames: int = 40, coverage_frames: int = 2000, trajectory_frames: int = 400
) -> dict[str, dict[str, float]]:
    """Return all figures by case; every run gives the same numbers."""
    figures = {}
    for lens in LENSES:
        for method, shares in against_oracle(METHODS, lens, oracle_frames).items():
            figures[f"{method} {lens}"] = shares | coverage(method, lens, coverage_frames)
    figures[TRAJECTORY] = whole_trajectory(oracle_frames, trajectory_frames)
    return figures


def shortfalls(found: dict[str, dict[str, float]], baseline: dict[str, dict[str, float]]) -> list[str]:
    """Return figures that are worse than the baseline beyond machine differences, or that miss a limit."""
    said = []
    for case, figures in found.items():
        for name, value in figures.items():
            reference = baseline[case][name]
            bad = (
                abs(value - reference) > 0.005
                if name.startswith("covered")
                else value > reference * (1.03 if name.startswith("p99") else 1.005)
            )
            if bad:
                said.append(f"{case} {name}: {value:.4f}, baseline {reference:.4f}")
        limit = PROMISED.get(case, 1.03)
        if figures["median_of_oracle"] > limit:
            said.append(f"{case}: median is {figures['median_of_oracle']:.4f} of the oracle's, limit {limit}")
        low, high = (0.91, 0.98) if case == TRAJECTORY else (0.93, 0.97)
        if not low <= figures["covered_95"] <= high:
            said.append(f"{case}: 95 % regions hold {figures['covered_95']:.3f}")
    return said


def main() -> int:
    """Measure and print accuracy, and compare it with the baseline."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--update", action="store_true", help="replace the baseline by this measurement")
    update = parser.parse_args().update
    found = measure()
    for case, figures in found.items():
        print(f"{case:17}", "  ".join(f"{name} {value:.4f}" for name, value in figures.items()))
    if update:
        BASELINE.write_text(json.dumps(found, indent=2) + "\n")
        return 0
    said = shortfalls(found, json.loads(BASELINE.read_text()))
    print("\n".join(said) or "no worse than the baseline")
    return 1 if said else 0


if __name__ == "__main__":
    sys.exit(main())
