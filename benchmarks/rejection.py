"""Compare the outlier rejection of all methods and of other programs: accuracy relative to an oracle, and CPU time.

``python -m benchmarks.rejection [--frames N] [--only NAME,...]``. The oracle is the maximum-likelihood point of the
true inliers with the true noise, which no method knows. Scored points are seen by at least three true inlier views and
returned by the method; the others are reported separately. Every other program runs in its own locked environment, on
one core, between two runs of posefuse.
"""

import argparse
import os
import statistics
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.speed import median_cpu_s, run_peer
from benchmarks.walking import RATE_HZ, SIGMA_PX, Walk, walk, with_one_wrong_view, with_swapped_sides
from posefuse.io.calibration import anipose
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer, unpack_covariance
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.pipeline.reconstruct import triangulate
from posefuse.synthetic.rigs import build_rig, look_at

FRAMES = 7700
"""200,200 points of 26 keypoints."""
FAR_M = 0.05
REGION_68, REGION_95 = 3.5059, 7.8147
FLAGS = (PointStatus.AMBIGUOUS, PointStatus.TWO_VIEWS)
SIZES_PX = (0, 5, 8, 10, 14, 20, 30, 40, 60, 100, 200, 400)


@dataclass(frozen=True)
class Score:
    """Errors of a method's points that three or more inlier views see.

    Attributes:
        mean_mm, rmse_mm, median_mm, p99_mm: statistics of the errors.
        far: share beyond 5 cm.
        missing: share of these points that the method did not return.
    """

    mean_mm: float
    rmse_mm: float
    median_mm: float
    p99_mm: float
    far: float
    missing: float

    @classmethod
    def of(cls, points_m: np.ndarray, data: Walk, scored: np.ndarray) -> "Score":
        """Score points (frame, keypoint, 3) where ``scored`` (frame, keypoint) is true."""
        error = np.linalg.norm(points_m - data.points_m[: len(points_m)], axis=-1)[scored[: len(points_m)]]
        there = error[np.isfinite(error)]
        return cls(
            1000 * float(there.mean()),
            1000 * float(np.sqrt(np.square(there).mean())),
            1000 * float(np.median(there)),
            1000 * float(np.percentile(there, 99)),
            float((there > FAR_M).mean()),
            1.0 - len(there) / len(error),
        )


def options_of(method: str = "consensus", **options: object) -> Options:
    """Return options with a method, and defaults otherwise."""
    return Options(pairs="labels", triangulation=TriangulationOptions(method=method), **options)  # type: ignore[arg-type]


def measured(data: Walk, options: Options) -> Layer:
    """Return the measured layer."""
    return triangulate(data.rig, data.detections, options).layers["measured"]


def oracle(data: Walk) -> np.ndarray:
    """Return the points of all true inliers with the true noise, shape (frame, keypoint, 3)."""
    pixels = np.where(data.inlier[..., None], data.pixels, np.nan)
    given = Options(noise_scale_px=SIGMA_PX, triangulation=TriangulationOptions("simple", min_views=2))
    return measured(replace(data, pixels=pixels), given).points_m[:, 0]


def covered(layer: Layer, data: Walk, scored: np.ndarray) -> tuple[float, float]:
    """Return the shares of points inside their 68 and 95 % regions."""
    scored = scored & layer.has_point[:, 0]
    offset = (layer.points_m[:, 0] - data.points_m)[scored]
    inverse = np.linalg.inv(unpack_covariance(layer.covariance_m2[:, 0])[scored])
    squared = np.einsum("ni,nij,nj->n", offset, inverse, offset)
    return float((squared < REGION_68).mean()), float((squared < REGION_95).mean())


def flagged(layer: Layer, data: Walk, scored: np.ndarray) -> tuple[int, int]:
    """Count wrong points (beyond 5 cm) with too few inlier views, and those of them whose status is a warning."""
    error = np.linalg.norm(layer.points_m[:, 0] - data.points_m, axis=-1)
    wrong = ~scored & (error > FAR_M)
    return int(wrong.sum()), int((wrong & np.isin(layer.status[:, 0], FLAGS)).sum())


def line(name: str, data: Walk, options: Options) -> str:
    """Format the results of a set on one line."""
    scored = data.inlier.sum(axis=1) >= 3
    layer = measured(data, options)
    ours, best = Score.of(layer.points_m[:, 0], data, scored), Score.of(oracle(data), data, scored)
    low, high = covered(layer, data, scored)
    wrong, warned = flagged(layer, data, scored)
    spent = 1000 * median_cpu_s(lambda: measured(data, options), 3) / len(data.pixels)
    return (
        f"{name:24}{best.median_mm:6.2f}{ours.median_mm / best.median_mm:7.3f}{best.p99_mm:7.1f}"
        f"{ours.p99_mm / best.p99_mm:7.3f}{ours.rmse_mm / best.rmse_mm:7.3f}{100 * best.far:7.3f}{100 * ours.far:7.3f}"
        f"{100 * ours.missing:7.3f}{100 * low:6.1f}{100 * high:6.1f}{wrong:6d}{warned:6d}{spent:8.3f}"
    )


HEADING = (
    f"{'':24}{'oracle':>6}{'ours':>7}{'oracle':>7}{'ours':>7}{'ours':>7}{'oracle':>7}{'ours':>7}{'ours':>7}"
    f"{'inside':>12}{'< 3 inliers':>12}{'CPU ms':>8}\n"
    f"{'':24}{'median':>6}{'median':>7}{'p99':>7}{'p99':>7}{'rmse':>7}{'>5 cm':>7}{'>5 cm':>7}{'miss.':>7}"
    f"{'68 %':>6}{'95 %':>6}{'wrong':>6}{'flag':>6}{'/frame':>8}\n"
    f"{'':24}{'mm':>6}{'ratio':>7}{'mm':>7}{'ratio':>7}{'ratio':>7}{'%':>7}{'%':>7}{'%':>7}{'%':>6}{'%':>6}"
)


def freemocap_ring(cameras: int) -> CameraRig:
    """Return the rig of FreeMoCap's accuracy table: radius 4 m, heights 1.5 and 2 m, f 1100 px, k1 -0.05."""
    rig = build_rig("ring", cameras, "barrel", focal_px=1100.0)
    angle = 2 * np.pi * np.arange(cameras) / cameras
    centers = np.stack([4 * np.cos(angle), 4 * np.sin(angle), np.where(np.arange(cameras) % 2, 2.0, 1.5)], axis=1)
    return CameraRig(
        tuple(
            replace(camera, camera_from_world=look_at(center, np.array([0, 0, 0.9])), distortion=(-0.05, 0, 0, 0, 0))
            for camera, center in zip(rig.cameras, centers, strict=True)
        ),
        up_axis="z",
    )


def freemocap_cases(frames: int) -> Iterator[tuple[str, Walk]]:
    """Yield the cases of FreeMoCap's accuracy table."""

    def case(cameras: int, share: float = 0.0, px: tuple[float, float] = (50.0, 400.0), missing: float = 0.0) -> Walk:
        return walk(
            frames, rig=freemocap_ring(cameras), outlier_share=share, outlier_px=px, missing_share=missing,
            skeleton="mediapipe_33",
        )  # fmt: skip

    for cameras, share in ((4, 0.05), (5, 0.05), (6, 0.05), (6, 0.1)):
        yield f"{cameras} cameras, {100 * share:.0f} %", case(cameras, share)
    yield "5, 5 %, 10 % missing", case(5, 0.05, missing=0.1)
    yield "5, sides swapped", with_swapped_sides(case(5))
    yield "5, 5 % of 10-40 px", case(5, 0.05, (10.0, 40.0))
    yield "5, clean", case(5)
    yield "4, clean", case(4)


def sets(frames: int) -> None:
    """Print results with gross outliers: few and many, different lenses, missing keypoints."""
    print(f"\nGross outliers of 30 to 300 px, 26 keypoints, {frames} frames\n{HEADING}")
    print(line("5 cameras, clean", walk(frames), options_of()), flush=True)
    for lens in ("pinhole", "barrel", "fisheye"):
        print(line(f"5 cameras, 5 %, {lens}", walk(frames, 5, lens, outlier_share=0.05), options_of()), flush=True)
    for cameras in (5, 8, 12, 16, 32):
        data = walk(frames, cameras, outlier_share=0.4)
        print(line(f"{cameras} cameras, 40 %", data, options_of()), flush=True)
    data = walk(frames, 3, missing_share=0.2)
    print(line("3 cameras, 20 % missing", data, options_of()), flush=True)
    seen = data.inlier.sum(axis=1)
    layer = measured(data, options_of())
    print(
        f"   points with coordinates though fewer than 2 views see them: {int(layer.has_point[:, 0][seen < 2].sum())}"
    )


def table(frames: int) -> None:
    """Print FreeMoCap's accuracy table for 33 keypoints."""
    print(f"\n33 keypoints, 4 m, f 1100 px, outliers of 50 to 400 px, {frames} frames\n{HEADING}")
    for name, data in freemocap_cases(frames):
        print(line(name, data, options_of()), flush=True)


def sizes(frames: int) -> None:
    """Print errors with one wrong view of five at every point."""
    data = walk(frames, rig=build_rig("ring", 5, focal_px=1100.0))
    print(f"\nOne wrong view of five at every point, f 1100 px, {frames} frames: mean error relative to the oracle")
    print(f"{'size px':>10}{'oracle mm':>10}{'consensus':>11}{'rejected %':>11}{'simple':>9}{'noise px':>10}")
    for size in SIZES_PX:
        moved = with_one_wrong_view(data, size) if size else data
        scored = np.ones(moved.inlier.shape[::2], dtype=bool)
        oracle_mm = Score.of(oracle(moved), moved, scored).mean_mm
        result = triangulate(moved.rig, moved.detections, options_of())
        layer = result.layers["measured"]
        simple = Score.of(measured(moved, options_of("simple")).points_m[:, 0], moved, scored).mean_mm
        ours = Score.of(layer.points_m[:, 0], moved, scored).mean_mm
        outlier = np.moveaxis(layer.view_status[:, 0] == ViewStatus.OUTLIER, -1, 1)
        rejected = 100 * outlier[~moved.inlier].mean() if size else np.nan
        print(
            f"{size:10}{oracle_mm:10.2f}{ours / oracle_mm:11.3f}{rejected:11.1f}{simple / oracle_mm:9.2f}"
            f"{float(np.median(result.noise.scale_px)):10.2f}",
            flush=True,
        )


def jumps(frames: int) -> None:
    """Print second differences of the points over time, and how often ``weighted_subsets`` keeps a wrong view."""
    data = walk(frames, outlier_share=0.05)
    print(f"\n5 cameras, 5 %, {frames} frames at {RATE_HZ:.0f} Hz: second differences, m/s^2")
    print(f"{'':20}{'median':>8}{'99 %':>8}")
    for method in ("simple", "weighted_subsets", "percentile_filter", "consensus"):
        points = measured(data, options_of(method)).points_m[:, 0]
        jump = RATE_HZ**2 * np.linalg.norm(np.diff(points, 2, axis=0), axis=-1)
        print(f"{method:20}{np.nanmedian(jump):8.0f}{np.nanpercentile(jump, 99):8.0f}", flush=True)
    data = walk(min(frames, 100), rig=build_rig("ring", 5, focal_px=1100.0))
    print("\nOne wrong view of five at every point, f 1100 px, weighted_subsets: points that keep all views, %")
    for size in (20, 30, 40):
        layer = measured(with_one_wrong_view(data, size), options_of("weighted_subsets"))
        kept = (layer.view_status != ViewStatus.OUTLIER).all(axis=-1)
        print(f"{size:6} px{100 * kept.mean():8.1f}", flush=True)


PEERS: tuple[tuple[str, str, tuple[str, ...], int], ...] = (
    ("FreeMoCap 1.8.2, rejection", "freemocap", ("--mode", "rejection"), 300),
    ("FreeMoCap 1.8.2, simple", "freemocap", ("--mode", "simple"), 1000),
    ("Pose2Sim 0.10.49", "pose2sim", (), 100),
    ("aniposelib 0.8", "aniposelib", (), 7700),
    ("aniposelib 0.8, ransac", "aniposelib", ("--mode", "ransac"), 2),
)


def compare_programs(frames: int) -> None:
    """Print results of all methods and programs on the same data: five cameras, 5 % gross outliers."""
    data = walk(frames, outlier_share=0.05)
    scored = data.inlier.sum(axis=1) >= 3
    methods = ("consensus", "weighted_subsets", "percentile_filter", "ransac", "irls", "simple", "midpoint")
    print(f"\n5 cameras, 5 %: all programs on the same data, up to {frames} frames, CPU ms per frame of 26 keypoints")
    print(
        f"{'':28}{'median mm':>10}{'p99 mm':>9}{'>5 cm %':>9}{'missing %':>11}{'CPU ms':>10}{'/ ours':>9}{'/ w.s.':>9}"
    )

    def show(name: str, score: Score, spent: float, *ratios: float) -> None:
        print(
            f"{name:28}{score.median_mm:10.2f}{score.p99_mm:9.1f}{100 * score.far:9.3f}{100 * score.missing:11.3f}"
            f"{spent:10.4f}" + "".join(f"{ratio:9.0f}" for ratio in ratios),
            flush=True,
        )

    show("oracle", Score.of(oracle(data), data, scored), np.nan)
    for method in methods:
        options = options_of(method)
        layer = measured(data, options)
        show(method, Score.of(layer.points_m[:, 0], data, scored), spent_ms(data, options))
    with tempfile.TemporaryDirectory() as folder:
        write_inputs(data, Path(folder))
        for name, peer, arguments, most in PEERS:
            few = ("--frames", str(min(most, frames)))
            ours, peer_ms, subsets = [], [], []
            for _ in range(3 if most > 2 else 1):
                before = [spent_ms(data, options_of(method), 1) for method in ("consensus", "weighted_subsets")]
                peer_ms.append(run_peer(peer, Path(folder), *arguments, *few)["ms_per_frame"])
                after = [spent_ms(data, options_of(method), 1) for method in ("consensus", "weighted_subsets")]
                ours.append(peer_ms[-1] / (0.5 * (before[0] + after[0])))
                subsets.append(peer_ms[-1] / (0.5 * (before[1] + after[1])))
            points = np.load(Path(folder) / f"{peer}.npy")
            ratios = statistics.median(ours), statistics.median(subsets)
            show(name, Score.of(points, data, scored), statistics.median(peer_ms), *ratios)


def spent_ms(data: Walk, options: Options, runs: int = 3) -> float:
    """Return CPU ms per frame, including noise estimation."""
    return 1000 * median_cpu_s(lambda: measured(data, options), runs) / len(data.pixels)


def write_inputs(data: Walk, folder: Path) -> None:
    """Write the input of the other programs."""
    anipose.write(data.rig, folder / "calibration.toml")
    np.save(folder / "points.npy", np.moveaxis(data.pixels, 1, 0))
    np.save(folder / "confidence.npy", np.moveaxis(data.confidence, 1, 0))


def rates(frames: int) -> None:
    """Print frames per second with 33 and with 553 keypoints, five cameras, 5 % outliers."""
    print("\nFrames per second, 5 cameras, 5 %, including noise estimation")
    few = walk(frames, rig=freemocap_ring(5), outlier_share=0.05, outlier_px=(50.0, 400.0), skeleton="mediapipe_33")
    print(f"  33 keypoints: {1000 / spent_ms(few, options_of()):.0f}", flush=True)
    many = walk(max(frames // 17, 200), rig=few.rig, outlier_share=0.05, outlier_px=(50.0, 400.0), skeleton=MANY)
    print(f"  553 keypoints: {1000 / spent_ms(many, options_of()):.0f}", flush=True)


MANY = "mediapipe_holistic_553"
PARTS: dict[str, Callable[[int], None]] = {
    "sets": sets,
    "table": lambda frames: table(frames * 26 // 33 + 1),
    "sizes": lambda frames: sizes(min(frames, 1000)),
    "jumps": lambda frames: jumps(min(frames, 400)),
    "rates": lambda frames: rates(min(frames, 3000)),
    "peers": compare_programs,
}


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=FRAMES, help="number of frames with 26 keypoints")
    parser.add_argument("--only", default=",".join(PARTS), help=f"comma-separated parts: {', '.join(PARTS)}")
    arguments = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    for part in arguments.only.split(","):
        PARTS[part](arguments.frames)


if __name__ == "__main__":
    main()
