"""Compare trajectory solves on the same data: posefuse, aniposelib, and filters tuned on the truth.

``python -m benchmarks.trajectory [--frames N] [--only NAME,...] [--data FOLDER] [--no-peer]``. All points are scored,
whether many cameras see them or none. ``oracle + smoother`` knows the true inliers and the true noise, and its smoother
is tuned on the truth, as is the cutoff of the Butterworth filter on the per-frame points of ``consensus``. aniposelib
solves the trajectory with the values of its command line, in its own locked environment, in the same run.
"""

import argparse
import os
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import filters, motions
from benchmarks.rejection import REGION_68, REGION_95, write_inputs
from benchmarks.speed import run_peer
from benchmarks.walking import SIGMA_PX, Walk, walk
from posefuse.evaluation.accuracy import bone_variation
from posefuse.evaluation.motion import accelerations_m_s2
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer, unpack_covariance
from posefuse.pipeline.reconstruct import triangulate
from posefuse.skeleton.skeletons import find_skeleton

FRAMES = 1000
FAR_M = 0.05
TUNED_FRAMES = 600
OURS = "trajectory"
DATA = Path(__file__).parent.parent.parent / "shared" / "data"


@dataclass(frozen=True)
class Path3D:
    """Result of a method on a recording.

    Attributes:
        points_m: shape (frame, keypoint, 3), NaN where missing.
        covariance_m2: shape (frame, keypoint, 3, 3), or None if the method has none.
        spent_ms: CPU time per frame; NaN for methods that use the truth.
        note: remark for the table.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray | None = None
    spent_ms: float = np.nan
    note: str = ""


@dataclass(frozen=True)
class Score:
    """Scores of a method on a recording.

    Attributes:
        median_mm, p99_mm: statistics of the errors.
        far: share of the returned points with errors above 5 cm.
        missing: share of all points.
        inside_68, inside_95: share of the points inside these regions of their covariance; NaN without one.
        spent_ms: CPU time per frame.
        bones: relative variation of bone lengths (1.48 times the median deviation, over the median).
        acceleration: ratio of the median acceleration to the truth's.
        wrong_side: share of leg keypoints that are closer to the other leg than to their own.
        note: remark of the method.
    """

    median_mm: float
    p99_mm: float
    far: float
    missing: float
    inside_68: float
    inside_95: float
    spent_ms: float
    bones: float
    acceleration: float
    wrong_side: float
    note: str

    @classmethod
    def of(cls, found: Path3D, data: Walk) -> "Score":
        """Score all points with known truth."""
        error = np.linalg.norm(found.points_m - data.points_m, axis=-1)
        there = error[np.isfinite(error)]
        if not there.size:
            raise ValueError("The method returned no points.")
        return cls(
            1000 * float(np.median(there)),
            1000 * float(np.percentile(there, 99)),
            float((there > FAR_M).mean()),
            1.0 - len(there) / error.size,
            *inside(found, data),
            found.spent_ms,
            bone_variation(found.points_m, find_skeleton(data.skeleton).edge_indices) or np.nan,
            jitter(found, data),
            on_wrong_side(found, data),
            found.note,
        )


def inside(found: Path3D, data: Walk) -> tuple[float, float]:
    """Return the shares of points inside the 68 and 95 % regions of their covariance."""
    if found.covariance_m2 is None:
        return np.nan, np.nan
    offset = found.points_m - data.points_m
    known = np.isfinite(offset).all(axis=-1) & np.isfinite(found.covariance_m2).all(axis=(-1, -2))
    given = offset[known]
    squared = (given * np.linalg.solve(found.covariance_m2[known], given[..., None])[..., 0]).sum(axis=-1)
    return float((squared < REGION_68).mean()), float((squared < REGION_95).mean())


def jitter(found: Path3D, data: Walk) -> float:
    """Return the ratio of the median acceleration to the truth's, where both are known."""
    ours, true = (accelerations_m_s2(points[:, None], data.times_s)[:, 0] for points in (found.points_m, data.points_m))
    both = np.isfinite(ours) & np.isfinite(true)
    truth = float(np.median(true[both])) if both.any() else 0.0
    return float(np.median(ours[both])) / truth if truth > 1e-6 else np.nan


def on_wrong_side(found: Path3D, data: Walk) -> float:
    """Return the share of leg keypoints closer to the other side than to their own, for legs 10 cm apart."""
    skeleton = find_skeleton(data.skeleton)
    parts = [p for p in ("knee", "ankle", "heel", "big_toe", "small_toe") if f"left_{p}" in skeleton.keypoints]
    sides = [[skeleton.index(f"{side}_{part}") for part in parts] for side in ("left", "right")]
    wrong, judged = 0, 0
    for own, other in (sides, sides[::-1]):
        to_own, to_other = (np.linalg.norm(found.points_m[:, own] - data.points_m[:, s], axis=-1) for s in (own, other))
        apart = np.linalg.norm(data.points_m[:, own] - data.points_m[:, other], axis=-1) > 0.1
        counted = apart & np.isfinite(to_own)
        wrong += int((counted & (to_other < to_own)).sum())
        judged += int(counted.sum())
    return wrong / max(judged, 1)


def per_frame(rig: CameraRig, detections: Detections) -> Layer:
    """Return the points of ``consensus`` per frame."""
    return triangulate(rig, detections, Options()).layers["measured"]


def solved(rig: CameraRig, detections: Detections) -> Layer:
    """Return the points of the trajectory solve."""
    from posefuse.model.options.trajectory import TrajectoryOptions
    from posefuse.trajectory.observations import MeasuredRange
    from posefuse.trajectory.priors import estimate_priors
    from posefuse.trajectory.solve import solve

    result = triangulate(rig, detections, Options())
    assert result.tracks is not None
    assert result.noise is not None
    layer = result.layers["measured"]
    measured = MeasuredRange(result.rig, detections, result.tracks, layer, result.swaps, result.noise)
    priors = estimate_priors([measured], detections.skeleton, TrajectoryOptions())
    return solve(measured, priors, TrajectoryOptions())


def timed(work: Callable[[CameraRig, Detections], Layer], data: Walk) -> Path3D:
    """Return a layer and the lowest CPU time of two runs, because the machine's speed drifts."""
    work(data.rig, data.first(60).detections)
    detections = data.detections
    spent = []
    for _ in range(2):
        start = time.process_time()
        work(data.rig, detections)
        spent.append(time.process_time() - start)
    layer = work(data.rig, detections)
    covariance = unpack_covariance(np.asarray(layer.covariance_m2)[:, 0])
    return Path3D(np.asarray(layer.points_m)[:, 0], covariance, 1000 * min(spent) / len(data.points_m))


def oracle(data: Walk) -> Path3D:
    """Return the points of the true inliers with the true noise, frame by frame."""
    lasting = not data.white
    given = Options(
        pairs="labels",
        noise_scale_px=motions.MEASURED_PX if lasting else SIGMA_PX,
        triangulation=TriangulationOptions("simple", min_views=2, confidence_exponent=1.0 if lasting else 0.0),
    )
    pixels = np.where(data.inlier[..., None], data.pixels, np.nan)
    layer = triangulate(data.rig, replace(data, pixels=pixels).detections, given).layers["measured"]
    return Path3D(np.asarray(layer.points_m)[:, 0], unpack_covariance(np.asarray(layer.covariance_m2)[:, 0]))


def median_m(points_m: np.ndarray, data: Walk) -> float:
    """Return the median distance from the truth."""
    return float(np.nanmedian(np.linalg.norm(points_m - data.points_m[: len(points_m)], axis=-1)))


def oracle_smoothed(data: Walk) -> Path3D:
    """Smooth the oracle's points with the density that fits the truth best."""
    points = oracle(data)
    assert points.covariance_m2 is not None
    given = points.points_m, points.covariance_m2, data.times_s
    few = tuple(each[:TUNED_FRAMES] for each in given)
    losses = [median_m(filters.smoother(few[0], few[1], few[2], density)[0], data) for density in filters.DENSITIES]
    density = filters.DENSITIES[int(np.argmin(losses))]
    points_m, covariance_m2 = filters.smoother(given[0], given[1], given[2], density)
    return Path3D(points_m, covariance_m2, note=f"{density:.3g} m2/s5")


def filtered(data: Walk, points_m: np.ndarray) -> Path3D:
    """Filter the points per frame with the Butterworth cutoff that fits the truth best."""
    tried = [filters.butterworth(points_m, data.rate_hz, cut_off) for cut_off in filters.CUT_OFFS_HZ]
    losses = [median_m(each, data) for each in tried]
    least = int(np.argmin(losses))
    return Path3D(tried[least], note=f"{filters.CUT_OFFS_HZ[least]:g} Hz")


def peer(data: Walk) -> Path3D:
    """Run aniposelib on the same pixels; limbs are the edges of the skeleton."""
    with tempfile.TemporaryDirectory() as folder:
        write_inputs(data, Path(folder))
        np.save(Path(folder) / "limbs.npy", find_skeleton(data.skeleton).edge_indices)
        figures = run_peer("aniposelib", Path(folder), "--mode", "optim", "--runs", "1")
        return Path3D(np.load(Path(folder) / "aniposelib.npy"), spent_ms=figures["ms_per_frame"])


def methods(data: Walk, with_peer: bool) -> Iterator[tuple[str, Path3D]]:
    """Yield the result of every method."""
    yield "oracle, per frame", oracle(data)
    yield "oracle + smoother, tuned", oracle_smoothed(data)
    measured = timed(per_frame, data)
    yield "consensus, per frame", measured
    yield "consensus + Butterworth, tuned", filtered(data, measured.points_m)
    if with_peer:
        yield "aniposelib optim_points", peer(data)
    if solved is not None:
        yield OURS, timed(solved, data)


HEADING = (
    f"{'':32}{'median':>7}{'p99':>7}{'> 5 cm':>8}{'missing':>8}{'inside':>12}{'CPU ms':>9}{'bones':>7}{'accel.':>7}"
    f"{'wrong':>8}\n{'':32}{'mm':>7}{'mm':>7}{'%':>8}{'%':>8}{'68 %':>6}{'95 %':>6}{'/frame':>9}{'%':>7}{'ratio':>7}"
    f"{'side %':>8}"
)


def line(name: str, score: Score) -> str:
    """Format the scores of a method on one line."""
    return (
        f"{name:32}{score.median_mm:7.2f}{score.p99_mm:7.1f}{100 * score.far:8.3f}{100 * score.missing:8.3f}"
        f"{100 * score.inside_68:6.1f}{100 * score.inside_95:6.1f}{score.spent_ms:9.3f}{100 * score.bones:7.2f}"
        f"{score.acceleration:7.2f}{100 * score.wrong_side:8.3f}  {score.note}"
    ).rstrip()


def by_views(found: Path3D, data: Walk) -> str:
    """Format the scores by the number of inlier views; points with few views depend on time and bones."""
    seen = data.inlier.sum(axis=1)
    error = 1000 * np.linalg.norm(found.points_m - data.points_m, axis=-1)
    parts = []
    for n, name in enumerate(("no view", "1 view", "2 views", "3 or more")):
        judged = seen == n if n < 3 else seen >= 3
        there = judged & np.isfinite(error)
        if there.any():
            these = replace(found, points_m=np.where(judged[..., None], found.points_m, np.nan))
            low, high = inside(these, data)
            parts.append(
                f"    {name:9}{int(judged.sum()):7d} points: median{np.median(error[there]):6.1f}, "
                f"p99{np.percentile(error[there], 99):7.1f} mm, "
                f"missing{100 * (1 - there.sum() / judged.sum()):6.2f} %, inside{100 * low:5.1f} /{100 * high:5.1f} %"
            )
        elif judged.any():
            parts.append(f"    {name:9}{int(judged.sum()):7d} points: all missing")
    return "\n".join(parts)


def show(name: str, data: Walk, with_peer: bool) -> None:
    """Print a recording's table."""
    print(f"\n{name}, {len(data.points_m)} frames\n{HEADING}", flush=True)
    for method, found in methods(data, with_peer):
        print(line(method, Score.of(found, data)), flush=True)
        if method == OURS:
            print(by_views(found, data), flush=True)


def sets(frames: int, folder: Path) -> dict[str, tuple[str, Callable[[], Walk]]]:
    """Return recordings by short name, with their descriptions and simulations."""
    return {
        "few": ("5 cameras, 5 % outliers", lambda: walk(frames, outlier_share=0.05)),
        "many": ("5 cameras, 40 % outliers", lambda: walk(frames, outlier_share=0.4)),
        "three": (
            "3 cameras, 20 % missing, 5 % outliers",
            lambda: walk(frames, 3, missing_share=0.2, outlier_share=0.05),
        ),
        "swaps": (
            "5 cameras, 5 % outliers, legs swapped in 15 % of views, frame by frame",
            lambda: motions.with_swapped_legs(walk(frames, outlier_share=0.05)),
        ),
        "spells": (
            "5 cameras, 5 % outliers, legs swapped in 15 % of views, for 0.4 s",
            lambda: motions.with_swapped_legs(walk(frames, outlier_share=0.05), dwell_s=0.4),
        ),
        "lasting": ("5 cameras, errors as measured: correlated", lambda: motions.with_lasting_noise(walk(frames))),
        "acts": ("5 cameras, errors as measured, walk, turn, reach, sit, jump", lambda: motions.acts(frames)),
        "panoptic": ("panoptic_motion at 60 Hz, 5 % outliers", lambda: motions.panoptic_at_60_hz(folder, frames)),
    }


def hard(frames: int) -> dict[str, tuple[str, Callable[[], Walk]]]:
    """Return recordings that are difficult for smoothers, by short name."""
    return {
        "still": ("a statue", lambda: motions.still(frames)),
        "jumps": ("stands still for 3 s, then jumps", lambda: motions.stand_then_jump(frames)),
        "hidden": ("a wrist that no camera sees for 0.5 s of 2", lambda: motions.hidden(frames)),
        "lonely": ("a wrist that one camera sees for 0.5 s of 2", lambda: motions.one_camera(frames)),
        "couple": ("two cameras for 1 s of 3", lambda: motions.two_cameras(frames)),
        "bursts": ("a view off by 60 px for ten frames, 5 % of the time", lambda: motions.bursts(frames)),
        "moment": ("legs swapped in two views at once for 0.3 s", lambda: motions.swapped_for_a_moment(frames)),
        "irregular": ("frames at irregular times", lambda: motions.irregular(frames)),
        "giant": (
            "a world a thousand times as large; mm and 5 cm are km",
            lambda: motions.scaled(walk(frames, outlier_share=0.05), 1000.0),
        ),
    }


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--only", help="short names of recordings")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of real recordings")
    parser.add_argument("--no-peer", action="store_true", help="skip aniposelib, which takes a minute per recording")
    given = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    warnings.simplefilter("ignore")
    usual, unusual = sets(given.frames, given.data), hard(given.frames)
    for short in given.only.split(",") if given.only else (*usual, *unusual):
        name, make = (usual | unusual)[short]
        show(name, make(), short in usual and not given.no_peer)


if __name__ == "__main__":
    main()
