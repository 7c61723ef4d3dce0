"""Compare calibrated cameras with the truth, free of the choice of the world and its scale."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from posefuse.model.cameras import Camera, CameraRig, vector_from_rotation


@dataclass(frozen=True)
class CalibrationScore:
    """Errors of a calibration; NaN where a number of cameras or the truth does not define them.

    Attributes:
        cameras: number of calibrated cameras, of those in the truth.
        rotation_deg: median error of the relative rotation of two cameras.
        worst_rotation_deg: maximum of the same.
        center_m: median distance of a camera center from the truth after the similarity that fits the other cameras.
        worst_center_m: maximum of the same.
        scale: size of the calibrated rig relative to the truth.
        focal: median relative error of the focal length.
        worst_focal: maximum of the same.
        offset_frames: median error of the time offset relative to the mean of the cameras, in frames of the camera.
        worst_offset_frames: maximum of the same.
    """

    cameras: int
    rotation_deg: float
    worst_rotation_deg: float
    center_m: float
    worst_center_m: float
    scale: float
    focal: float
    worst_focal: float
    offset_frames: float
    worst_offset_frames: float


@dataclass(frozen=True, eq=False)
class Similarity:
    """The map ``scale * rotation @ x + shift_m``."""

    scale: float
    rotation: np.ndarray
    shift_m: np.ndarray

    def __call__(self, points_m: np.ndarray) -> np.ndarray:
        """Map points, shape (..., 3)."""
        return self.scale * points_m @ self.rotation.T + self.shift_m


def score_calibration(
    estimate: CameraRig | Sequence[Camera],
    truth: CameraRig | Sequence[Camera],
    *,
    offset_s: np.ndarray | None = None,
    true_offset_s: np.ndarray | None = None,
    rate_hz: float | np.ndarray | None = None,
) -> CalibrationScore:
    """Score cameras against the true ones of the same name.

    Args:
        estimate: calibrated cameras in any world; cameras that are left out are not scored.
        truth: true cameras.
        offset_s: shape (estimated camera,): true time minus timestamp, up to a constant.
        true_offset_s: shape (true camera,): the same.
        rate_hz: frame rate, of all cameras or shape (true camera,).
    """
    given = tuple(estimate.cameras if isinstance(estimate, CameraRig) else estimate)
    every = tuple(truth.cameras if isinstance(truth, CameraRig) else truth)
    at = [[camera.name for camera in every].index(camera.name) for camera in given]
    true = [every[i] for i in at]
    turns = relative_rotations_deg(given, true)
    centers, scale = center_errors_m(given, true)
    focal = np.abs([a.matrix[0, 0] / b.matrix[0, 0] - 1.0 for a, b in zip(given, true, strict=True)])
    late = np.full(len(given), np.nan)
    if offset_s is not None and true_offset_s is not None and rate_hz is not None:
        apart = np.asarray(offset_s) - np.asarray(true_offset_s)[at]
        late = np.abs(apart - apart.mean()) * np.broadcast_to(np.asarray(rate_hz, dtype=float), len(every))[at]
    return CalibrationScore(
        len(given), *_middle_and_worst(turns), *_middle_and_worst(centers), scale, *_middle_and_worst(focal),
        *_middle_and_worst(late),
    )  # fmt: skip


def _middle_and_worst(errors: np.ndarray) -> tuple[float, float]:
    finite = np.asarray(errors)[np.isfinite(errors)]
    return (float(np.median(finite)), float(finite.max())) if len(finite) else (float("nan"), float("nan"))


def relative_rotations_deg(estimate: Sequence[Camera], truth: Sequence[Camera]) -> np.ndarray:
    """Return the error of the relative rotation of every pair of cameras, shape (pair,)."""
    errors = []
    for i, j in combinations(range(len(estimate)), 2):
        ours, theirs = (rig[j].rotation @ rig[i].rotation.T for rig in (estimate, truth))
        errors.append(np.degrees(np.linalg.norm(vector_from_rotation(ours @ theirs.T))))
    return np.array(errors)


def center_errors_m(estimate: Sequence[Camera], truth: Sequence[Camera]) -> tuple[np.ndarray, float]:
    """Return the error of every camera center, shape (camera,), and the scale of the estimate.

    Each camera is compared after the similarity that fits the centers of the others, which does not use the camera
    itself. With three cameras, the rotation of this similarity is that of the orientations; with two, errors are NaN.
    """
    ours, theirs = (np.array([camera.center_m for camera in rig]) for rig in (estimate, truth))
    n = len(ours)
    if n < 2:
        return np.full(n, np.nan), float("nan")
    scale = 1.0 / fit_similarity(ours, theirs, _world_rotation(estimate, truth) if n < 3 else None).scale
    errors = np.full(n, np.nan)
    for k in range(n if n > 2 else 0):
        rest = np.arange(n) != k
        others = [[camera for camera, kept in zip(rig, rest, strict=True) if kept] for rig in (estimate, truth)]
        rotation = _world_rotation(*others) if n == 3 else None
        errors[k] = np.linalg.norm(fit_similarity(ours[rest], theirs[rest], rotation)(ours[k]) - theirs[k])
    return errors, scale


def fit_similarity(source_m: np.ndarray, target_m: np.ndarray, rotation: np.ndarray | None = None) -> Similarity:
    """Return the similarity that maps points to others with the least squared error (Umeyama 1991).

    Args:
        source_m: shape (point, 3).
        target_m: the same.
        rotation: shape (3, 3), if it is known.
    """
    source_mean, target_mean = source_m.mean(axis=0), target_m.mean(axis=0)
    source, target = source_m - source_mean, target_m - target_mean
    if rotation is None:
        u, _, v = np.linalg.svd(target.T @ source)
        rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    scale = float((target * (source @ rotation.T)).sum() / (source**2).sum())
    return Similarity(scale, rotation, target_mean - scale * rotation @ source_mean)


def _world_rotation(estimate: Sequence[Camera], truth: Sequence[Camera]) -> np.ndarray:
    """Return the mean rotation from the world of the estimate to that of the truth."""
    total = sum(b.rotation.T @ a.rotation for a, b in zip(estimate, truth, strict=True))
    u, _, v = np.linalg.svd(total)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v


def in_true_world(estimate: CameraRig, truth: CameraRig) -> CameraRig:
    """Return the cameras in the world of the truth, by the similarity that fits all centers."""
    true = [truth[name] for name in estimate.names]
    ours, theirs = (np.array([camera.center_m for camera in rig]) for rig in (estimate.cameras, true))
    few = _world_rotation(estimate.cameras, true) if len(true) < 4 else None
    similarity = fit_similarity(ours, theirs, few)
    moved = []
    for camera in estimate.cameras:
        pose = np.eye(4)
        pose[:3, :3] = camera.rotation @ similarity.rotation.T
        pose[:3, 3] = -pose[:3, :3] @ similarity(camera.center_m)
        moved.append(replace(camera, camera_from_world=pose))
    return replace(estimate, cameras=tuple(moved), up_axis=truth.up_axis, inferred_up=None)
