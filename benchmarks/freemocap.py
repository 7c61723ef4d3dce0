"""Compare FreeMoCap's points with those of posefuse, point by point: its triangulation and both rejection methods.

``python -m benchmarks.freemocap [--frames N] [--write]``. FreeMoCap 1.8.2, and 1.7.4 for the reprojection error filter,
run in locked environments (``benchmarks/peers``). ``--write`` stores the figures in ``benchmarks/freemocap.json``.
"""

import argparse
import json
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tomli_w

from benchmarks.rejection import freemocap_ring
from benchmarks.speed import run_peer
from benchmarks.walking import Walk, walk
from posefuse.io.calibration import anipose
from posefuse.io.calibration.read import read_cameras
from posefuse.io.keypoints.read import read_detections
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import (
    FreeMoCapRules,
    PercentileFilterOptions,
    TriangulationOptions,
    WeightedSubsetsOptions,
)
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus
from posefuse.pipeline.reconstruct import triangulate
from posefuse.skeleton.skeletons import find_skeleton

FRAMES = 60
FIGURES = Path(__file__).with_suffix(".json")
REAL = Path(__file__).parents[2] / "shared" / "data" / "caliscope_webcams"
MM_PER_M = 1000.0


@dataclass(frozen=True)
class Case:
    """A recording and the options of the rejection.

    Attributes:
        name: name in the table.
        rig: the cameras.
        pixels: shape (frame, view, keypoint, 2).
        truth_m: shape (frame, keypoint, 3), or None for a real recording.
        min_cameras, drop: FreeMoCap's minimum number of cameras, and its maximum number of cameras to drop.
    """

    name: str
    rig: CameraRig
    pixels: np.ndarray
    truth_m: np.ndarray | None
    min_cameras: int = 3
    drop: int = 1


@dataclass(frozen=True)
class Program:
    """A method of FreeMoCap and its counterpart.

    Attributes:
        label: what FreeMoCap calls it.
        method: the method of posefuse.
        peer: folder of ``benchmarks/peers``.
        mode: ``--mode`` of its ``run.py``.
    """

    label: str
    method: str
    peer: str
    mode: str


PROGRAMS = (
    Program("1.8.2, triangulation", "simple", "freemocap", "simple"),
    Program("1.8.2, outlier rejection", "weighted_subsets", "freemocap", "rejection"),
    Program("1.7.4, reprojection error filter", "percentile_filter", "freemocap_1_7", "filter"),
)


def cases(frames: int) -> Iterator[Case]:
    """Yield the recordings: simulated ones of 33 keypoints with 2 px noise, and a real one where it is present."""

    def ring(
        name: str, cameras: int, share: float, missing: float = 0.0, px: tuple[float, float] = (50.0, 400.0),
        **given: int,
    ) -> Case:  # fmt: skip
        data = walk(
            frames, rig=freemocap_ring(cameras), outlier_share=share, outlier_px=px, missing_share=missing,
            skeleton="mediapipe_33",
        )  # fmt: skip
        return simulated(name, data, **given)

    yield ring("4 cameras, clean", 4, 0.0)
    yield ring("5 cameras, 5 % outliers", 5, 0.05)
    yield ring("5 cameras, 5 %, 10 % missing", 5, 0.05, 0.1)
    yield ring("5 cameras, 5 % of 300-1500 px", 5, 0.05, px=(300.0, 1500.0))
    yield ring("6 cameras, 10 %, drop 2 min. 2", 6, 0.1, drop=2, min_cameras=2)
    yield simulated(
        "5 cameras, 5 %, k1 = -0.28", walk(frames, 5, "barrel", outlier_share=0.05, skeleton="mediapipe_33")
    )
    if REAL.exists():
        pixels = read_detections(REAL / "xy_HOLISTIC.csv").dense()[0][:frames]
        yield Case("4 webcams, real, 33 keypoints", read_cameras(REAL / "config.toml"), pixels, None)


def simulated(name: str, data: Walk, **given: int) -> Case:
    """Return the case of simulated data."""
    return Case(name, data.rig, data.pixels, data.points_m, **given)


def write_inputs(case: Case, folder: Path) -> CameraRig:
    """Write the input of FreeMoCap, with lengths in mm as it has them, and return the rig as posefuse reads it."""
    path = folder / "calibration.toml"
    anipose.write(case.rig, path)
    tables = tomllib.loads(path.read_text("utf-8"))
    for key, table in tables.items():
        if key == "metadata":
            table["unit"] = "mm"
        else:
            table["translation"] = [MM_PER_M * value for value in table["translation"]]
    path.write_text(tomli_w.dumps(tables), "utf-8")
    np.save(folder / "points.npy", np.moveaxis(case.pixels, 1, 0))
    return anipose.read(path)


def peer_points_m(program: Program, case: Case, folder: Path) -> np.ndarray:
    """Return FreeMoCap's points, shape (frame, keypoint, 3)."""
    arguments = ["--mode", program.mode, "--min-cameras", str(case.min_cameras)]
    if program.peer == "freemocap":
        arguments += ["--drop", str(case.drop), "--runs", "1"]
    run_peer(program.peer, folder, *arguments)
    return np.load(folder / f"{program.peer}.npy") / MM_PER_M


def our_layer(method: str, rules: FreeMoCapRules, rig: CameraRig, case: Case) -> Layer:
    """Return the measured layer with FreeMoCap's settings."""
    chosen = TriangulationOptions(
        method=method,
        # FreeMoCap 1.7 triangulates from two cameras; its own minimum is that of the filter.
        min_views=2 if method == "percentile_filter" else case.min_cameras,
        min_confidence=0.0,
        freemocap_rules=rules,
        weighted_subsets=WeightedSubsetsOptions(target_normalized=0.01, max_cameras_to_drop=case.drop),
        percentile_filter=PercentileFilterOptions(min_views_left=case.min_cameras),
    )
    skeleton = find_skeleton("mediapipe_33")
    detections = Detections.from_dense(skeleton, rig.names, case.pixels, rate_hz=30.0)
    return triangulate(rig, detections, Options(pairs="labels", triangulation=chosen)).layers["measured"]


def figures(theirs_m: np.ndarray, ours_m: np.ndarray) -> dict[str, float]:
    """Return distances of points that both have, and the share of points that only one has."""
    one, other = np.isfinite(theirs_m[..., 0]), np.isfinite(ours_m[..., 0])
    distance_mm = MM_PER_M * np.linalg.norm(theirs_m - ours_m, axis=-1)[one & other]
    return {
        "median_mm": float(np.median(distance_mm)),
        "p99_mm": float(np.percentile(distance_mm, 99)),
        "max_mm": float(distance_mm.max()),
        "presence_percent": 100.0 * float((one != other).mean()),
    }


def errors(points_m: np.ndarray, case: Case) -> dict[str, float]:
    """Return the errors of points against the truth, and the share of missing ones."""
    if case.truth_m is None:
        return {}
    error_mm = MM_PER_M * np.linalg.norm(points_m - case.truth_m, axis=-1)
    return {
        "error_median_mm": float(np.nanmedian(error_mm)),
        "error_p99_mm": float(np.nanpercentile(error_mm, 99)),
        "missing_percent": 100.0 * float(np.isnan(error_mm).mean()),
    }


def compare(program: Program, case: Case) -> dict[str, dict[str, float]]:
    """Return figures of FreeMoCap, of posefuse under both rules, and of points that lose no view under either."""
    with tempfile.TemporaryDirectory() as folder:
        rig = write_inputs(case, Path(folder))
        theirs_m = peer_points_m(program, case, Path(folder))
    found = {"freemocap": errors(theirs_m, case)}
    layers: dict[FreeMoCapRules, Layer] = {
        rules: our_layer(program.method, rules, rig, case) for rules in ("program", "documentation")
    }
    for rules, layer in layers.items():
        ours_m = layer.points_m[:, 0]
        found[rules] = figures(theirs_m, ours_m) | errors(ours_m, case)
    full = [(layer.view_status != ViewStatus.OUTLIER).all(axis=-1) & layer.has_point for layer in layers.values()]
    both = (full[0] & full[1])[:, 0]
    kept = replace(case, truth_m=None)
    found["kept"] = figures(theirs_m[both], layers["documentation"].points_m[:, 0][both]) | errors(theirs_m, kept)
    found["kept"]["share_percent"] = 100.0 * float(both.mean())
    return found


def line(case: Case, found: dict[str, dict[str, float]]) -> str:
    """Format the figures of a case."""
    cells = [f"{case.name:32}"]
    for rules in ("program", "documentation"):
        each = found[rules]
        cells.append(
            f"{each['median_mm']:9.2g}{each['p99_mm']:9.2g}{each['max_mm']:9.2g}{each['presence_percent']:7.2f}"
        )
    for each in (found["freemocap"], found["documentation"]):
        if "error_p99_mm" in each:
            cells.append(f"{each['error_median_mm']:8.2f}{each['error_p99_mm']:8.1f}{each['missing_percent']:7.2f}")
    return "".join(cells)


HEADING = (
    f"{'':32}{'program: differences':>34}{'documentation: differences':>34}{'FreeMoCap':>23}{'documentation':>23}\n"
    f"{'':32}{'median':>9}{'99 %':>9}{'largest':>9}{'only 1':>7}{'median':>9}{'99 %':>9}{'largest':>9}{'only 1':>7}"
    f"{'median':>8}{'99 %':>8}{'miss.':>7}{'median':>8}{'99 %':>8}{'miss.':>7}\n"
    f"{'':32}{'mm':>9}{'mm':>9}{'mm':>9}{'%':>7}{'mm':>9}{'mm':>9}{'mm':>9}{'%':>7}"
    f"{'mm':>8}{'mm':>8}{'%':>7}{'mm':>8}{'mm':>8}{'%':>7}"
)


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--write", action="store_true", help="store the figures")
    given = parser.parse_args()
    stored: dict[str, dict[str, dict[str, dict[str, float]]]] = {}
    for program in PROGRAMS:
        print(f"\nFreeMoCap {program.label}, and {program.method}; {given.frames} frames\n{HEADING}")
        for case in cases(given.frames):
            found = compare(program, case)
            stored.setdefault(program.method, {})[case.name] = found
            print(line(case, found), flush=True)
    if given.write:
        FIGURES.write_text(json.dumps(stored, indent=1, sort_keys=True) + "\n", "utf-8")


if __name__ == "__main__":
    main()
