"""Estimate the pose of one camera from points that the other views triangulate (resection)."""

from dataclasses import replace

import numpy as np

from posefuse.diagnostics.normalized_views import normalize_views
from posefuse.diagnostics.observations import TrackedObservations
from posefuse.diagnostics.recording_model import RecordingModel
from posefuse.diagnostics.sample_points import STUDENT_T_DOF, SamplePoints, expected_noise, triangulate_samples
from posefuse.model.cameras import rotation_from_vector


def resect_camera(
    observations: TrackedObservations, model: RecordingModel, view: int, scale: float
) -> np.ndarray | None:
    """Estimate a camera_from_world pose, shape (4, 4), from the other views' points, or return None if too few."""
    normalized = normalize_views(observations, model)
    hidden = normalized.xy.copy()
    hidden[:, :, view] = np.nan
    points = triangulate_samples(observations, model, replace(normalized, xy=hidden), scale)
    world = points.points_m.reshape(-1, 3)
    xy = normalized.xy[:, :, view].reshape(-1, 2)
    sigma = (expected_noise(observations, normalized) * scale)[:, :, view].ravel()
    valid = np.isfinite(world).all(axis=-1) & np.isfinite(xy).all(axis=-1) & _verified(points).ravel()
    if valid.sum() < 60:
        return None
    starts = [middle_pose(model, view)]
    direct = _linear_pose(world[valid], xy[valid])
    if direct is not None:
        starts.append(direct)
    candidates = [_refine_annealed(world[valid], xy[valid], sigma[valid], start) for start in starts]
    return min(candidates, key=lambda pose: _bounded_loss(world[valid], xy[valid], sigma[valid], pose))


def middle_pose(model: RecordingModel, view: int) -> np.ndarray:
    """Return the camera_from_world pose of a view in the middle of the recording, shape (4, 4)."""
    middle, pose = len(model.frames) // 2, np.eye(4)
    pose[:3, :3], pose[:3, 3] = model.rotation[middle, view], model.translation_m[middle, view]
    return pose


def _verified(points: SamplePoints) -> np.ndarray:
    """Return which points have at least two views within 3 standard deviations."""
    agree = (points.weight > 0) & (np.square(points.residual).sum(axis=-1) < 9.0)
    return agree.sum(axis=-1) >= 2


def _linear_pose(world: np.ndarray, xy: np.ndarray) -> np.ndarray | None:
    """Return a pose from the direct linear transform, refitted three times to the best 70 % of the points."""
    inliers = np.ones(len(world), dtype=bool)
    pose = None
    middle, size = np.median(world, axis=0), float(np.std(world)) or 1.0
    local = np.concatenate([(world - middle) / size, np.ones((len(world), 1))], axis=1)
    for _ in range(3):
        zero = np.zeros((inliers.sum(), 4))
        selected, u, v = local[inliers], xy[inliers, :1], xy[inliers, 1:]
        rows = np.concatenate(
            [
                np.concatenate([selected, zero, -u * selected], axis=1),
                np.concatenate([zero, selected, -v * selected], axis=1),
            ]
        )
        matrix = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 4)
        matrix = matrix * np.sign(np.median(local @ matrix[2]))
        left, singular_values, right = np.linalg.svd(matrix[:, :3])
        if singular_values[1] < 1e-9:
            return pose
        rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        translation = matrix[:, 3] / singular_values.mean() * size
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, translation - rotation @ middle
        error = np.linalg.norm(_project(world, pose) - xy, axis=-1)
        inliers = error <= np.nanquantile(error, 0.7)
        if inliers.sum() < 12:
            return pose
    return pose


def _project(world: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Project world points to the normalized image plane."""
    camera_xyz = world @ pose[:3, :3].T + pose[:3, 3]
    return camera_xyz[:, :2] / np.where(camera_xyz[:, 2:] > 1e-6, camera_xyz[:, 2:], 1e-6)


def _refine_annealed(world: np.ndarray, xy: np.ndarray, sigma: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Refine a pose by robust Gauss-Newton steps while the assumed noise decreases to its actual value."""
    pose = pose.copy()
    for width in (*np.geomspace(64.0, 1.0, 13), 1.0, 1.0):
        camera_xyz = world @ pose[:3, :3].T + pose[:3, 3]
        valid = camera_xyz[:, 2] > 1e-3
        x, y, z = camera_xyz[valid].T
        noise = sigma[valid] * width
        residual = (xy[valid] - np.stack([x / z, y / z], axis=1)) / noise[:, None]
        weight = (STUDENT_T_DOF + 2.0) / (STUDENT_T_DOF + np.square(residual).sum(axis=1))
        zero = np.zeros_like(x)
        by_point = np.stack([np.stack([1 / z, zero, -x / z**2], -1), np.stack([zero, 1 / z, -y / z**2], -1)], axis=1)
        by_rotation = -np.stack(
            [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], axis=1
        )
        rows = np.concatenate([by_point @ by_rotation, by_point], axis=-1) / noise[:, None, None]
        weighted = rows * weight[:, None, None]
        normal = np.einsum("nki,nkj->ij", weighted, rows)
        step = np.linalg.solve(normal + 1e-9 * np.trace(normal) * np.eye(6), np.einsum("nki,nk->i", weighted, residual))
        rotation = rotation_from_vector(step[:3])
        pose[:3, :3] = rotation @ pose[:3, :3]
        pose[:3, 3] = rotation @ pose[:3, 3] + step[3:]
    return pose


def _bounded_loss(world: np.ndarray, xy: np.ndarray, sigma: np.ndarray, pose: np.ndarray) -> float:
    """Return the mean bounded squared error of a pose."""
    camera_xyz = world @ pose[:3, :3].T + pose[:3, 3]
    squared = np.square((_project(world, pose) - xy) / sigma[:, None]).sum(axis=1)
    return float(np.minimum(np.where(camera_xyz[:, 2] > 0, squared, np.inf), 16.0).mean())
