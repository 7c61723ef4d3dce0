"""Simulate the shared data of the benchmarks: a walking figure in a ring of cameras."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import HumanMotion
from posefuse.synthetic.options import LensKind
from posefuse.synthetic.rigs import build_rig

RATE_HZ = 60.0
SIGMA_PX = 2.0


@dataclass(frozen=True)
class Walk:
    """A recording with known truth.

    Attributes:
        rig: the cameras.
        points_m: shape (frame, keypoint, 3).
        pixels: shape (frame, view, keypoint, 2), as detected.
        confidence: shape (frame, view, keypoint), unrelated to the noise.
        inlier: shape (frame, view, keypoint), bool: not a gross outlier, not missing.
        skeleton: name of the skeleton.
        rate_hz: nominal frame rate.
        time_s: shape (frame,), for unevenly spaced frames; None for evenly spaced ones.
        white: whether the errors of inliers are white noise of SIGMA_PX; otherwise they follow the measured error
            model.
    """

    rig: CameraRig
    points_m: np.ndarray
    pixels: np.ndarray
    confidence: np.ndarray
    inlier: np.ndarray
    skeleton: str = "halpe_26"
    rate_hz: float = RATE_HZ
    time_s: np.ndarray | None = None
    white: bool = True

    @property
    def times_s(self) -> np.ndarray:
        """Return the times of the frames, shape (frame,)."""
        return np.arange(len(self.points_m)) / self.rate_hz if self.time_s is None else self.time_s

    def first(self, frames: int) -> "Walk":
        """Return the first frames."""
        return self.between(slice(0, frames))

    def between(self, span: slice) -> "Walk":
        """Return some of the frames."""
        cut = {name: getattr(self, name)[span] for name in ("points_m", "pixels", "confidence", "inlier")}
        return replace(self, **cut, time_s=None if self.time_s is None else self.time_s[span])

    @property
    def detections(self) -> Detections:
        """Return the detections for posefuse."""
        skeleton = find_skeleton(self.skeleton)
        times = None if self.time_s is None else np.repeat(self.time_s[:, None], len(self.rig), axis=1)
        return Detections.from_dense(
            skeleton, self.rig.names, self.pixels, self.confidence, rate_hz=self.rate_hz, time_s=times
        )


def walk(
    frames: int,
    cameras: int = 5,
    lens: LensKind = "pinhole",
    *,
    outlier_share: float = 0.0,
    outlier_px: tuple[float, float] = (30.0, 300.0),
    missing_share: float = 0.0,
    sigma_px: float = SIGMA_PX,
    skeleton: str = "halpe_26",
    rig: CameraRig | None = None,
    seed: int = 0,
) -> Walk:
    """Simulate white Gaussian noise, gross outliers in random directions, and randomly missing keypoints."""
    rng = np.random.default_rng(seed)
    keypoints = find_skeleton(skeleton)
    figure = human(1.75)
    motion = HumanMotion.random(("walk",), rng)
    points = motion.positions(figure, np.arange(frames) / RATE_HZ)[:, figure.columns(keypoints)]
    rig = rig or build_rig("ring", cameras, lens)
    seen = observe(
        rig, points, rng, sigma_px=sigma_px, outlier_share=outlier_share, outlier_px=outlier_px,
        missing_share=missing_share,
    )  # fmt: skip
    return replace(seen, skeleton=skeleton)


def observe(
    rig: CameraRig,
    points_m: np.ndarray,
    rng: np.random.Generator,
    *,
    sigma_px: float = SIGMA_PX,
    outlier_share: float = 0.0,
    outlier_px: tuple[float, float] = (30.0, 300.0),
    missing_share: float = 0.0,
) -> Walk:
    """Simulate the detections of any motion, shape (frame, keypoint, 3), with the noise of :func:`walk`."""
    pixels = rig.project(points_m)
    pixels = pixels + sigma_px * rng.standard_normal(pixels.shape)
    shape = pixels.shape[:-1]
    outlier = rng.random(shape) < outlier_share
    direction, distance = rng.uniform(0, 2 * np.pi, shape), rng.uniform(*outlier_px, shape)
    pixels += (outlier * distance)[..., None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    missing = rng.random(shape) < missing_share
    pixels[missing] = np.nan
    return Walk(rig, points_m, pixels, rng.uniform(0.35, 0.9, shape), ~outlier & ~missing)


def with_one_wrong_view(data: Walk, size_px: float, seed: int = 1) -> Walk:
    """Return a copy with one observation of every point moved by a distance in a random direction."""
    rng = np.random.default_rng(seed)
    frames, views, keypoints, _ = data.pixels.shape
    view = rng.integers(0, views, (frames, keypoints))
    angle = rng.uniform(0, 2 * np.pi, view.shape)
    f, k = np.indices(view.shape)
    pixels, inlier = data.pixels.copy(), data.inlier.copy()
    pixels[f, view, k] += size_px * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    inlier[f, view, k] = False
    return replace(data, pixels=pixels, inlier=inlier)


def with_swapped_sides(data: Walk, run: int = 30, seed: int = 2) -> Walk:
    """Return a copy with left and right swapped in one view at a time, half of the time, for periods."""
    rng = np.random.default_rng(seed)
    skeleton = find_skeleton(data.skeleton)
    pixels, inlier = data.pixels.copy(), data.inlier.copy()
    pairs = [pair for pair in skeleton.pairs if not any(part in pair[0] for part in ("eye", "ear", "mouth"))]
    left, right = (np.array([skeleton.keypoints.index(pair[side]) for pair in pairs]) for side in (0, 1))
    for start in range(0, len(pixels), 2 * run):
        view, span = rng.integers(pixels.shape[1]), slice(start, start + run)
        before = pixels[span, view].copy()
        pixels[span, view, left], pixels[span, view, right] = before[:, right], before[:, left]
        inlier[span, view, left] = inlier[span, view, right] = False
    return replace(data, pixels=pixels, inlier=inlier)
