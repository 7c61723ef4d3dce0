"""Benchmark of paired keypoints with label swaps, compared with the oracle, original labels, and sds.

``python -m benchmarks.pairs [--trials N] [--only NAME,...]``. Cameras in a ring of 4.5 m, 1.5 to 2.5 m high, f 1500 px,
5 px noise, pairs anywhere in a cube of 1 m, 300 mm apart; a view swaps with probability 0.25, one of its keypoints is
up to 200 px off with probability 0.10, a keypoint is missing with probability 0.10. The oracle knows the true pairing,
the true inliers and the noise; the methods know the noise. An error is the mean distance of both points, by best
matching, over the trials in which the oracle has both (two inlier views each); trials in which a method returns fewer
are counted separately. Everything runs on one core.
"""

import argparse
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.speed import median_cpu_s
from posefuse.left_right.pairs import enumerated, population_search
from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.pairs import PairOptions
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.status import PointStatus
from posefuse.model.tracks import Tracks, TrackState
from posefuse.skeleton.skeletons import Skeleton
from posefuse.synthetic.rigs import build_rig, look_at
from posefuse.triangulation import consensus
from posefuse.triangulation.observations import Observations

TRIALS = 5000
FAR_MM = 100.0
OPTIONS = TriangulationOptions(min_views=2)


@dataclass(frozen=True)
class Scene:
    """Pairs observed by a ring of cameras, and the faults of each observation.

    Attributes:
        rig: the cameras.
        points_m: shape (trial, 2, 3).
        pixels: shape (trial, view, 2, 2), as labeled.
        truth: shape (trial, view, 2): point that the observation of each label shows.
        inlier: shape (trial, view, 2), bool: present, and not a gross outlier.
        sigma_px: standard deviation of the noise.
        pairs: number of keypoint pairs per frame.
    """

    rig: CameraRig
    points_m: np.ndarray
    pixels: np.ndarray
    truth: np.ndarray
    inlier: np.ndarray
    sigma_px: float
    pairs: int = 1

    @property
    def detections(self) -> Detections:
        """Return the detections for a method, with ``pairs`` pairs per frame."""
        n, views = self.pixels.shape[:2]
        frames = n // self.pairs
        by_frame = self.pixels[: frames * self.pairs].reshape(frames, self.pairs, views, 2, 2)
        pixels = np.moveaxis(by_frame, 2, 1).reshape(frames, views, 2 * self.pairs, 2)
        names = tuple(f"{side}_{i}" for i in range(self.pairs) for side in ("left", "right"))
        skeleton = Skeleton("pairs", names, pairs=tuple(zip(names[::2], names[1::2], strict=True)))
        return Detections.from_dense(skeleton, self.rig.names, pixels, np.ones(pixels.shape[:-1]), rate_hz=60.0)

    @property
    def tracks(self) -> Tracks:
        """Return tracks of one person who is always present."""
        frames = len(self.pixels) // self.pairs
        detection = np.zeros((frames, 1, len(self.rig)), dtype=np.int32)
        return Tracks(("p0",), detection, np.full((frames, 1), TrackState.ACTIVE, dtype=np.int8))

    @property
    def noise(self) -> NoiseModel:
        """Return the true noise model."""
        return NoiseModel(np.full(len(self.rig), self.sigma_px))


def ring(cameras: int) -> CameraRig:
    """Return cameras evenly spaced on a ring of 4.5 m, 1.5 to 2.5 m high."""
    rig = build_rig("ring", cameras, focal_px=1500.0)
    angle = 2.0 * np.pi * np.arange(cameras) / cameras
    height = 1.5 + np.arange(cameras) * 0.618034 % 1.0
    centers = np.stack([4.5 * np.cos(angle), 4.5 * np.sin(angle), height], axis=1)
    target = np.array([0.0, 0.0, 0.9])
    return CameraRig(
        tuple(
            replace(camera, camera_from_world=look_at(center, target))
            for camera, center in zip(rig.cameras, centers, strict=True)
        ),
        up_axis="z",
    )


def scattered(n: int, apart_m: float, rng: np.random.Generator) -> np.ndarray:
    """Return pairs at random positions and directions in the cube, shape (n, 2, 3)."""
    center = rng.uniform([-0.5, -0.5, 0.4], [0.5, 0.5, 1.4], (n, 3))
    direction = rng.standard_normal((n, 3))
    half = 0.5 * apart_m * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return np.stack([center + half, center - half], axis=1)


def walking(n: int, rng: np.random.Generator) -> np.ndarray:
    """Return alternating ankles on a circle at 60 frames per second and 1 m/s, shape (n, 2, 3)."""
    time = np.arange(n) / 60.0
    heading = time / 1.0 + rng.uniform(0.0, 2.0 * np.pi)
    middle = np.stack([np.cos(heading), np.sin(heading), np.full(n, 0.5)], axis=1) * [0.45, 0.45, 1.0]
    forward = np.stack([-np.sin(heading), np.cos(heading), np.zeros(n)], axis=1)
    outward = np.stack([np.cos(heading), np.sin(heading), np.zeros(n)], axis=1)
    swing = 0.25 * np.sin(2.0 * np.pi * 0.9 * time)[:, None]
    return np.stack([middle - 0.1 * outward + swing * forward, middle + 0.1 * outward - swing * forward], axis=1)


def scene(
    n: int,
    cameras: int,
    *,
    sigma_px: float = 5.0,
    swap: float = 0.25,
    outlier: float = 0.0,
    missing: float = 0.0,
    apart_m: float = 0.3,
    walk: bool = False,
    pairs: int = 1,
    seed: int = 0,
) -> Scene:
    """Simulate pairs with the faults of a case."""
    rng = np.random.default_rng(seed)
    rig = ring(cameras)
    points = walking(n, rng) if walk else scattered(n, apart_m, rng)
    pixels = rig.project(points)
    pixels = pixels + sigma_px * rng.standard_normal(pixels.shape)
    wrong = (rng.random((n, cameras)) < outlier)[..., None] & (rng.integers(0, 2, (n, cameras))[..., None] == [0, 1])
    pixels += wrong[..., None] * rng.uniform(-200.0, 200.0, pixels.shape)
    absent = rng.random((n, cameras, 2)) < missing
    pixels[absent] = np.nan
    inlier = ~wrong & ~absent
    truth = np.broadcast_to(np.arange(2), inlier.shape).copy()
    swapped = rng.random((n, cameras)) < swap
    for array in (pixels, inlier, truth):
        array[swapped] = array[swapped][:, ::-1]
    return Scene(rig, points, pixels, truth, inlier, sigma_px, pairs)


def oracle(data: Scene) -> np.ndarray:
    """Return the maximum-likelihood points of the true inliers with the true pairing, shape (trial, 2, 3)."""
    points = np.empty(data.points_m.shape)
    for side in range(2):
        mine = data.inlier & (data.truth == side)
        pixels = np.where(mine[..., None], data.pixels, 0.0).sum(axis=2)
        seen = mine.any(axis=2)
        pixels = np.where(seen[..., None], pixels, np.nan)
        points[:, side] = Observations(data.rig, data.noise, pixels, np.ones(seen.shape)).solve(seen).points_m
    return points


def call_of(
    data: Scene, method: Callable[..., SolvedPairs], pair_options: PairOptions | None = None
) -> Callable[[], SolvedPairs]:
    """Return a method's call with all arguments bound."""
    pairs = np.arange(2 * data.pairs).reshape(-1, 2)
    given = pair_options or PairOptions()
    return partial(method, data.rig, data.detections, data.tracks, data.noise, OPTIONS, pairs, given)


def solved(data: Scene, method: Callable[..., SolvedPairs], pair_options: PairOptions | None = None) -> SolvedPairs:
    """Return the points of a method."""
    return call_of(data, method, pair_options)()


def believed(data: Scene) -> np.ndarray:
    """Return the points by consensus for each label separately, shape (trial, 2, 3)."""
    layer = consensus.solve(data.rig, data.detections, data.tracks, data.noise, OPTIONS)
    return np.asarray(layer.points_m)[:, 0]


def errors_mm(points_m: np.ndarray, truth_m: np.ndarray) -> np.ndarray:
    """Return the mean distance of both points, by best matching, NaN if one is missing, shape (trial,)."""
    straight = np.linalg.norm(points_m - truth_m, axis=-1).mean(axis=-1)
    crossed = np.linalg.norm(points_m[:, ::-1] - truth_m, axis=-1).mean(axis=-1)
    return 1000.0 * np.minimum(straight, crossed)


def far(points_m: np.ndarray, truth_m: np.ndarray) -> np.ndarray:
    """Return whether a point is more than 100 mm off by the best matching, shape (trial,), bool."""
    distance = np.linalg.norm(points_m[:, :, None] - truth_m[:, None], axis=-1)
    straight = np.maximum(distance[:, 0, 0], distance[:, 1, 1])
    crossed = np.maximum(distance[:, 0, 1], distance[:, 1, 0])
    return 1000.0 * np.minimum(straight, crossed) > FAR_MM


@dataclass(frozen=True)
class Score:
    """Median and 95th percentile in mm, share beyond 100 mm, and share missing."""

    median: float
    p95: float
    far: float
    missing: float

    @classmethod
    def of(cls, points_m: np.ndarray, data: Scene, judged: np.ndarray) -> "Score":
        """Return the score of the scored trials."""
        error = errors_mm(points_m, data.points_m)[judged]
        there = np.isfinite(error)
        beyond = far(points_m, data.points_m)[judged][there]
        kept = error[there]
        return cls(float(np.median(kept)), float(np.percentile(kept, 95)), float(beyond.mean()), 1.0 - there.mean())

    def __str__(self) -> str:
        return f"{self.median:7.2f}{self.p95:8.2f}{100 * self.far:7.2f}{100 * self.missing:7.2f}"


CASES: dict[str, tuple[dict[str, object], float]] = {
    "8, no faults, 3 px": ({"cameras": 8, "sigma_px": 3.0, "swap": 0.0}, 0.0),
    "8, swaps": ({"cameras": 8}, 0.0),
    "8, outliers, missing": ({"cameras": 8, "outlier": 0.1, "missing": 0.1}, 0.05),
    "8, same, 100 mm apart": ({"cameras": 8, "outlier": 0.1, "missing": 0.1, "apart_m": 0.1}, 0.1),
    "5, outliers, missing": ({"cameras": 5, "outlier": 0.1, "missing": 0.1}, 4.0),
    "5, same, walking": ({"cameras": 5, "outlier": 0.1, "missing": 0.1, "walk": True}, 1.5),
    "4, missing": ({"cameras": 4, "missing": 0.1}, 0.8),
}
"""Simulated cases by name, and the allowed excess of the share beyond 100 mm over the oracle's, in percent."""

PRIOR_M = 0.05
"""Distance that ankles move in one frame of 1/60 s."""


def table(trials: int) -> None:
    """Print every case: the oracle, our methods, sds, and original labels."""
    print(f"\n{trials} trials: median mm, 95 % mm, beyond 100 mm %, missing %; ratios of ours to the oracle's")
    print(f"{'':24}{'oracle':^29}{'enumerate':^29}{'med.':>7}{'p95':>7}{'+%':>7}{'limit':>6}{'sds':^29}{'labels':^29}")
    for name, (drawn, allowed) in CASES.items():
        data = scene(trials, **drawn)  # type: ignore[arg-type]
        best = oracle(data)
        judged = np.isfinite(best).all(axis=(1, 2))
        options = PairOptions(motion_sd_m=PRIOR_M) if drawn.get("walk") else PairOptions()
        floor = Score.of(best, data, judged)
        ours = Score.of(solved(data, enumerated.solve, options).points_m[:, 0], data, judged)
        searched = Score.of(solved(data, population_search.solve).points_m[:, 0], data, judged)
        labels = Score.of(believed(data), data, judged)
        print(
            f"{name:24}{floor}{ours}{ours.median / floor.median:7.3f}{ours.p95 / floor.p95:7.3f}"
            f"{100 * (ours.far - floor.far):7.2f}{allowed:6.2f}{searched}{labels}",
            flush=True,
        )


def flags(trials: int) -> None:
    """Print how many points with two inlier views are wrong, and how many of those are flagged."""
    print(
        "\npoints with two inlier views: number, beyond 100 mm, ambiguous ones of these; and the same for other points"
    )
    for name, (drawn, _) in CASES.items():
        data = scene(trials, **drawn)  # type: ignore[arg-type]
        result = solved(data, enumerated.solve)
        points, status = result.points_m[:, 0], result.status[:, 0]
        distance = np.linalg.norm(points[:, :, None] - data.points_m[:, None], axis=-1)
        crossed = distance[:, 0, 0] + distance[:, 1, 1] > distance[:, 0, 1] + distance[:, 1, 0]
        truth = np.where(crossed[:, None], [1, 0], [0, 1])
        seen = np.stack([(data.inlier & (data.truth == side)).sum(axis=(1, 2)) for side in range(2)], axis=1)
        seen = np.take_along_axis(seen, truth, axis=1)
        wrong = 1000.0 * np.take_along_axis(distance, truth[..., None], axis=2)[..., 0] > FAR_MM
        flagged = (status == PointStatus.AMBIGUOUS) | (status == PointStatus.UNDECIDED)
        two, more, has = seen == 2, seen > 2, status < PointStatus.NOT_SEEN
        print(
            f"{name:24}two: {int(two.sum()):5} flagged {int((two & flagged).sum()):5} wrong "
            f"{int((two & wrong).sum()):5} "
            f"flagged {int((two & wrong & flagged).sum()):5}   more: {int(more.sum()):6} flagged "
            f"{int((more & flagged).sum()):5} "
            f"wrong {int((more & has & wrong).sum()):5} flagged {int((more & wrong & flagged).sum()):5}",
            flush=True,
        )


def unswapped(trials: int) -> None:
    """Print the cost of ignoring the labels when there are no swaps."""
    print("\nno swaps: mean error mm of the pair solve, with labels, ratio")
    for cameras in (4, 5, 8):
        for faults in ({}, {"outlier": 0.1, "missing": 0.1}):
            data = scene(trials, cameras, swap=0.0, **faults)  # type: ignore[arg-type]
            ours = errors_mm(solved(data, enumerated.solve).points_m[:, 0], data.points_m)
            labels = errors_mm(believed(data), data.points_m)
            both = np.isfinite(ours) & np.isfinite(labels)
            mean, theirs = ours[both].mean(), labels[both].mean()
            median, median_theirs = np.median(ours[both]), np.median(labels[both])
            print(
                f"{cameras} cameras, {'outliers and missing' if faults else 'clean':22}mean {mean:7.2f}{theirs:7.2f}"
                f"{mean / theirs:7.3f}   median {median:7.2f}{median_theirs:7.2f}{median / median_theirs:7.3f}",
                flush=True,
            )


def speed(trials: int) -> None:
    """Print the CPU ms per frame of 12 pairs, and the ratio of sds."""
    print("\nCPU ms per frame of 12 pairs, one thread; sds; ratio")
    for cameras, asked in ((8, 0.25), (16, 2.0)):
        data = scene(12 * max(trials // 12, 40), cameras, outlier=0.1, missing=0.1, pairs=12)
        few = replace(data, pixels=data.pixels[: 12 * 20])
        frames, few_frames = len(data.pixels) // 12, 20
        ours = 1000 * median_cpu_s(call_of(data, enumerated.solve), 7) / frames
        theirs = 1000 * median_cpu_s(call_of(few, population_search.solve), 3) / few_frames
        print(f"{cameras:3} cameras {ours:8.4f} (limit {asked}) {theirs:9.3f}{theirs / ours:8.1f}", flush=True)


PARTS: dict[str, Callable[[int], None]] = {"table": table, "flags": flags, "unswapped": unswapped, "speed": speed}


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--only", default=",".join(PARTS), help=f"some of {', '.join(PARTS)}")
    given = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    for part in given.only.split(","):
        PARTS[part](given.trials)


if __name__ == "__main__":
    main()
