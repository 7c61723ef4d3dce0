"""The data all benchmarks share: a walking figure of 26 keypoints in a ring of cameras."""

from dataclasses import dataclass

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.skeletons import find_skeleton
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
        confidence: shape (frame, view, keypoint), saying nothing about the noise.
        inlier: shape (frame, view, keypoint), bool: not a gross outlier, not missing.
    """

    rig: CameraRig
    points_m: np.ndarray
    pixels: np.ndarray
    confidence: np.ndarray
    inlier: np.ndarray

    @property
    def detections(self) -> Detections:
        """What posefuse is given."""
        skeleton = find_skeleton("halpe_26")
        return Detections.from_dense(skeleton, self.rig.names, self.pixels, self.confidence, rate_hz=RATE_HZ)


def walk(
    frames: int,
    cameras: int = 5,
    lens: LensKind = "pinhole",
    *,
    outlier_share: float = 0.0,
    missing_share: float = 0.0,
    sigma_px: float = SIGMA_PX,
    seed: int = 0,
) -> Walk:
    """White Gaussian noise, gross outliers of 30 to 300 px, keypoints missing at random."""
    rng = np.random.default_rng(seed)
    skeleton = find_skeleton("halpe_26")
    figure = human(1.75)
    motion = HumanMotion.random(("walk",), rng)
    points = motion.positions(figure, np.arange(frames) / RATE_HZ)[:, figure.columns(skeleton)]
    rig = build_rig("ring", cameras, lens)
    pixels = np.moveaxis(rig.project(points), 0, 1)
    pixels = pixels + sigma_px * rng.standard_normal(pixels.shape)
    shape = pixels.shape[:-1]
    outlier = rng.random(shape) < outlier_share
    direction, distance = rng.uniform(0, 2 * np.pi, shape), rng.uniform(30, 300, shape)
    pixels += (outlier * distance)[..., None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    missing = rng.random(shape) < missing_share
    pixels[missing] = np.nan
    return Walk(rig, points, pixels, rng.uniform(0.35, 0.9, shape), ~outlier & ~missing)
