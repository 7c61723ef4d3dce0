"""Estimate the pose of a camera from known points, without an initial pose.

Many small samples each give a pose by the direct linear transform on viewing rays (Hartley and Zisserman 2004, chapter
7; rays support any lens). The pose with the lowest bounded loss is refined by Gauss-Newton on reprojection errors with
Student-t weights.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.normal_equations import STUDENT_T_DOF, compute_rows
from posefuse.calibration.parameters import N_PARAMETERS, FreeParameters, Refine, apply_changes
from posefuse.calibration.point_observations import PointObservations
from posefuse.model.cameras import Camera, CameraRig

MIN_POINTS = 20
_SAMPLES_PER_SIZE = 250
_SAMPLE_SIZES = (6, 8, 12, 24)
_MAX_SCORED = 300
_N_REFINED = 12
_MAX_STEPS = 50
_MIN_DISTANCE = 1e-3
_MIN_FLATNESS = 1e-3
_MEDIAN_LENGTH = float(np.sqrt(2.0 * np.log(2.0)))


@dataclass(frozen=True, eq=False)
class LocatedCamera:
    """Hold an estimated camera.

    Attributes:
        camera: with its new pose.
        error_px: median reprojection error.
        agreeing: share of the points within three standard deviations.
    """

    camera: Camera
    error_px: float
    agreeing: float


def locate(
    camera: Camera, points_m: np.ndarray, pixels: np.ndarray, refine: Refine = "extrinsics", seed: int = 0
) -> LocatedCamera | None:
    """Estimate the pose of a camera.

    Args:
        camera: its lens; its pose is ignored.
        points_m: shape (point, 3), in the world; must not be coplanar.
        pixels: shape (point, 2): observations; NaN where there is none.
        refine: whether the focal length, and the first two distortion coefficients, may change too.
        seed: random seed of the samples.

    Returns:
        The camera with its pose, or None if there are too few points, the points are nearly coplanar, or no pose agrees
        with them.
    """
    rays, codes = camera.rays(pixels)
    valid = (codes == 0) & np.isfinite(points_m).all(axis=1)
    points_m, pixels, rays = points_m[valid], pixels[valid], rays[valid]
    if len(points_m) < MIN_POINTS or flatness(points_m) < _MIN_FLATNESS:
        return None
    poses = _proposals(points_m, rays, np.random.default_rng(seed))
    scored = np.unique(np.linspace(0, len(points_m) - 1, _MAX_SCORED).astype(int))
    order = np.argsort(_disagreement(poses, points_m[scored], rays[scored]), kind="stable")[:_N_REFINED]
    free = FreeParameters.of(CameraRig((camera,)), refine).free[0]
    refined = [_refine_pose(_with_pose(camera, poses[i]), points_m[scored], pixels[scored], free) for i in order]
    best = min(refined, key=lambda candidate: _cost(candidate, points_m, pixels))
    best = _refine_pose(best, points_m, pixels, free)
    errors_px = _errors_px(best, points_m, pixels)
    median = float(np.median(errors_px))
    return LocatedCamera(best, median, float((errors_px < 3.0 * max(median, 0.1) / _MEDIAN_LENGTH).mean()))


def flatness(points_m: np.ndarray) -> float:
    """Return the smallest extent of points relative to the largest; 0 if they are coplanar."""
    spread = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False)
    return float(spread[2] / max(spread[0], 1e-300))


def _proposals(points_m: np.ndarray, rays: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return candidate poses from samples of all sizes, shape (pose, 3, 4).

    Small samples avoid outliers, large ones average noise.
    """
    center, size = points_m.mean(axis=0), points_m.std()
    scaled = np.concatenate([(points_m - center) / size, np.ones((len(points_m), 1))], axis=1)
    # A ray r sees a point X where r x (P X) = 0: linear in P.
    cross = np.zeros((len(rays), 3, 3))
    cross[:, [2, 0, 1], [1, 2, 0]] = rays[:, [0, 1, 2]]
    cross[:, [1, 2, 0], [2, 0, 1]] = -rays[:, [0, 1, 2]]
    rows = np.einsum("nij,nk->nijk", cross, scaled).reshape(len(rays), 3, 12)
    squares = np.einsum("nij,nik->njk", rows, rows)
    samples = [np.arange(len(rays))]
    for size_of_sample in _SAMPLE_SIZES:
        count = min(size_of_sample, len(rays))
        samples += [rng.choice(len(rays), count, replace=False) for _ in range(_SAMPLES_PER_SIZE)]
    sums = np.array([squares[sample].sum(axis=0) for sample in samples])
    _, vectors = np.linalg.eigh(sums)
    rigid = _rigid(vectors[:, :, 0].reshape(-1, 3, 4), np.einsum("nj,nk->njk", rays, scaled).sum(axis=0))
    # Convert from scaled points back to meters.
    rigid[:, :, 3] = size * rigid[:, :, 3] - rigid[:, :, :3] @ center
    return rigid


def _rigid(matrices: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return the rotations and translations nearest to matrices that are known up to a factor.

    Args:
        matrices: shape (pose, 3, 4).
        along: shape (3, 4): sum of the products of rays and points, which selects the sign with points in front.
    """
    matrices = matrices * np.where(np.einsum("pij,ij->p", matrices, along) < 0.0, -1.0, 1.0)[:, None, None]
    left, values, right = np.linalg.svd(matrices[:, :, :3])
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    out = np.empty_like(matrices)
    out[:, :, :3] = left @ right
    out[:, :, 3] = matrices[:, :, 3] / np.maximum(values.mean(axis=1), 1e-300)[:, None]
    return out


def _disagreement(poses: np.ndarray, points_m: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Return the mean logarithmic distance of the point directions from the rays, shape (pose,)."""
    projected = np.einsum("pij,nj->pni", poses[:, :, :3], points_m) + poses[:, None, :, 3]
    projected /= np.maximum(np.linalg.norm(projected, axis=2, keepdims=True), 1e-300)
    return np.log(np.linalg.norm(projected - rays, axis=2) + _MIN_DISTANCE).mean(axis=1)


def _with_pose(camera: Camera, pose: np.ndarray) -> Camera:
    """Return the camera with another pose."""
    whole = np.eye(4)
    whole[:3] = pose
    return replace(camera, camera_from_world=whole)


def _errors_px(camera: Camera, points_m: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return bounded reprojection errors."""
    projected, codes = camera.project(points_m)
    diagonal_px = float(np.hypot(*camera.size_px))
    return np.where(codes == 0, np.minimum(np.linalg.norm(projected - pixels, axis=1), diagonal_px), diagonal_px)


def _cost(camera: Camera, points_m: np.ndarray, pixels: np.ndarray) -> float:
    """Return the mean logarithmic error, which needs no scale and limits the influence of outliers."""
    return float(np.log(_errors_px(camera, points_m, pixels) + 1e-3 * camera.size_px[0]).mean())


def _refine_pose(camera: Camera, points_m: np.ndarray, pixels: np.ndarray, free: np.ndarray) -> Camera:
    """Refine the free parameters by Gauss-Newton; the noise is re-estimated in every step."""
    n = len(points_m)
    index = np.arange(n)
    observations = PointObservations(np.zeros(n, dtype=np.int64), index, pixels, np.ones(n), points_m, index, index)
    rig = CameraRig((camera,))
    for _ in range(_MAX_STEPS):
        rows = compute_rows(rig, observations, points_m, np.ones(1))
        scale = max(float(np.median(np.sqrt(rows.squared))) / _MEDIAN_LENGTH, 1e-6)
        weight = (STUDENT_T_DOF + 2.0) / (STUDENT_T_DOF + rows.squared / scale**2)
        by_camera = rows.by_camera[:, :, free]
        matrix = np.einsum("n,nij,nik->jk", weight, by_camera, by_camera)
        matrix[np.diag_indices_from(matrix)] *= 1.0 + 1e-6
        step = np.linalg.lstsq(matrix, -np.einsum("n,nij,ni->j", weight, by_camera, rows.residual), rcond=1e-14)[0]
        change = np.zeros((1, N_PARAMETERS))
        change[0, free] = step * min(1.0, 0.3 / max(float(np.abs(np.delete(step, [3, 4, 5])).max()), 1e-12))
        rig = apply_changes(rig, change)
        if np.abs(step).max() < 1e-9:
            break
    return rig.cameras[0]
