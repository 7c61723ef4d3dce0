"""Small scenes used by many tests."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton, find_skeleton
from posefuse.synthetic.rigs import build_rig, look_at

MATRIX = np.array([[1200.0, 0.0, 959.5], [0.0, 1210.0, 539.5], [0.0, 0.0, 1.0]])

LENSES = {
    "pinhole": (LensModel.PINHOLE, ()),
    "mild": (LensModel.BROWN, (-0.05, 0.01, 2e-4, -3e-4, 0.001)),
    "barrel": (LensModel.BROWN, (-0.28, 0.0, 1e-3, 5e-4, 0.0)),
    "pincushion": (LensModel.BROWN, (0.15, 0.05, -1e-3, 4e-4, 0.02)),
    "rational": (LensModel.RATIONAL, (0.4, -0.2, 5e-4, -2e-4, 0.03, 0.7, -0.1, 0.02)),
    "fisheye": (LensModel.FISHEYE, (-0.02, 0.003, -0.001, 0.0002)),
}
"""Lens models with realistic coefficients."""


def camera_with(lens: str, name: str = "cam", pose: np.ndarray | None = None) -> Camera:
    """Return a camera with one of LENSES; the fisheye has a shorter focal length."""
    model, distortion = LENSES[lens]
    matrix = MATRIX.copy()
    if lens == "fisheye":
        matrix[0, 0], matrix[1, 1] = 600.0, 605.0
    return Camera(name, (1920, 1080), matrix, np.eye(4) if pose is None else pose, model, distortion)


def ring(n: int = 5, lens: str = "pinhole") -> CameraRig:
    """Return cameras on a circle of 5 m that look at the middle of a person."""
    angle = 2 * np.pi * np.arange(n) / n
    centers = np.stack([5 * np.cos(angle), 5 * np.sin(angle), 1.5 + (np.arange(n) % 2)], axis=1)
    target = np.array([0.0, 0.0, 0.9])
    cameras = tuple(camera_with(lens, f"cam_{i}", look_at(center, target)) for i, center in enumerate(centers))
    return CameraRig(cameras, up_axis="z")


def body_points(rng: np.random.Generator, n: int, keypoints: int = 17) -> np.ndarray:
    """Return random points in the volume of a person, shape (n, keypoints, 3)."""
    return rng.uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 1.8], (n, keypoints, 3))


def simulate_detections(
    rig: CameraRig, points_m: np.ndarray, rng: np.random.Generator, sigma_px: float = 2.0, rate_hz: float | None = 60.0
) -> Detections:
    """Return the detections of points (frame, keypoint, 3) with white noise."""
    pixels = rig.project(points_m)
    pixels = pixels + sigma_px * rng.standard_normal(pixels.shape)
    confidence = rng.uniform(0.5, 0.9, pixels.shape[:-1])
    return Detections.from_dense(skeleton_of(points_m.shape[1]), rig.names, pixels, confidence, rate_hz=rate_hz)


def skeleton_of(n: int) -> Skeleton:
    """Return a skeleton of n keypoints: COCO's without plausible lengths if n is 17, otherwise a chain."""
    if n == 17:
        return replace(find_skeleton("coco_17"), plausible_m=())
    names = tuple(f"point_{i}" for i in range(n))
    return Skeleton("chain", names, tuple(pairwise(names)))


__all__ = ["LENSES", "body_points", "build_rig", "camera_with", "ring", "simulate_detections", "skeleton_of"]
