"""A camera located from scratch: where it must stand to see known points where it does. Its given pose is not used.

Many small samples each give a pose by the direct linear transformation on viewing rays (Hartley & Zisserman 2004,
chapter 7; rays, so that any lens will do); the pose that most points agree with, each counting no more than a bound, is
refined by Gauss-Newton on reprojection errors that follow Student's t.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.normal import NU, rows_of
from posefuse.calibration.parameters import N_PARAMETERS, Freedom, Refine, changed
from posefuse.calibration.sightings import Sightings
from posefuse.model.cameras import Camera, CameraRig

FEWEST_POINTS = 20
_SAMPLES = 250
_SAMPLE_SIZES = (6, 8, 12, 24)
_JUDGES = 300
_BEST = 12
_STEPS = 50
_FINE = 1e-3
_FLAT = 1e-3
_MEDIAN_LENGTH = float(np.sqrt(2.0 * np.log(2.0)))


@dataclass(frozen=True, eq=False)
class Located:
    """A camera found.

    Attributes:
        camera: with its new pose.
        error_px: median distance of what it saw from where it would see it.
        agreeing: share of the points within three times the noise.
    """

    camera: Camera
    error_px: float
    agreeing: float


def locate(
    camera: Camera, points_m: np.ndarray, pixels: np.ndarray, refine: Refine = "extrinsics", seed: int = 0
) -> Located | None:
    """Find where a camera stands.

    Args:
        camera: its lens; its pose is not looked at.
        points_m: shape (point, 3), in the world; spread in all three directions.
        pixels: shape (point, 2), what the camera saw of them; NaN where nothing.
        refine: whether its focal length, and its first two distortion terms, may change as well.
        seed: of the samples.

    Returns:
        The camera in its place, or None where the points are too few, or all lie in one plane or nearly so, or no
        place agrees with them.
    """
    rays, codes = camera.rays(pixels)
    good = (codes == 0) & np.isfinite(points_m).all(axis=1)
    points_m, pixels, rays = points_m[good], pixels[good], rays[good]
    if len(points_m) < FEWEST_POINTS or flatness(points_m) < _FLAT:
        return None
    poses = _proposals(points_m, rays, np.random.default_rng(seed))
    judges = np.unique(np.linspace(0, len(points_m) - 1, _JUDGES).astype(int))
    order = np.argsort(_disagreement(poses, points_m[judges], rays[judges]), kind="stable")[:_BEST]
    freedom = Freedom.of(CameraRig((camera,)), refine).free[0]
    tried = [_refined(_placed(camera, poses[i]), points_m[judges], pixels[judges], freedom) for i in order]
    best = min(tried, key=lambda each: _cost(each, points_m, pixels))
    best = _refined(best, points_m, pixels, freedom)
    lengths = _lengths(best, points_m, pixels)
    median = float(np.median(lengths))
    return Located(best, median, float((lengths < 3.0 * max(median, 0.1) / _MEDIAN_LENGTH).mean()))


def flatness(points_m: np.ndarray) -> float:
    """The smallest extent of points relative to the largest: 0 where all lie in a plane."""
    spread = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False)
    return float(spread[2] / max(spread[0], 1e-300))


def _proposals(points_m: np.ndarray, rays: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Poses, shape (pose, 3, 4), from samples of all sizes: small ones may hold no wrong point, large ones average."""
    centre, size = points_m.mean(axis=0), points_m.std()
    scaled = np.concatenate([(points_m - centre) / size, np.ones((len(points_m), 1))], axis=1)
    # A ray r sees a point X where r x (P X) = 0: linear in P.
    cross = np.zeros((len(rays), 3, 3))
    cross[:, [2, 0, 1], [1, 2, 0]] = rays[:, [0, 1, 2]]
    cross[:, [1, 2, 0], [2, 0, 1]] = -rays[:, [0, 1, 2]]
    rows = np.einsum("nij,nk->nijk", cross, scaled).reshape(len(rays), 3, 12)
    squares = np.einsum("nij,nik->njk", rows, rows)
    samples = [np.arange(len(rays))]
    for size_of_sample in _SAMPLE_SIZES:
        count = min(size_of_sample, len(rays))
        samples += [rng.choice(len(rays), count, replace=False) for _ in range(_SAMPLES)]
    sums = np.array([squares[sample].sum(axis=0) for sample in samples])
    _, vectors = np.linalg.eigh(sums)
    rigid = _rigid(vectors[:, :, 0].reshape(-1, 3, 4), np.einsum("nj,nk->njk", rays, scaled).sum(axis=0))
    # From scaled points back to metres.
    rigid[:, :, 3] = size * rigid[:, :, 3] - rigid[:, :, :3] @ centre
    return rigid


def _rigid(matrices: np.ndarray, along: np.ndarray) -> np.ndarray:
    """The rotations and translations nearest to matrices that are theirs but for a factor.

    Args:
        matrices: shape (pose, 3, 4).
        along: shape (3, 4), the sum of products of rays and points: points lie before the camera.
    """
    matrices = matrices * np.where(np.einsum("pij,ij->p", matrices, along) < 0.0, -1.0, 1.0)[:, None, None]
    left, values, right = np.linalg.svd(matrices[:, :, :3])
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    out = np.empty_like(matrices)
    out[:, :, :3] = left @ right
    out[:, :, 3] = matrices[:, :, 3] / np.maximum(values.mean(axis=1), 1e-300)[:, None]
    return out


def _disagreement(poses: np.ndarray, points_m: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Shape (pose,): the mean logarithm of the distance of unit vectors to the points from the rays."""
    seen = np.einsum("pij,nj->pni", poses[:, :, :3], points_m) + poses[:, None, :, 3]
    seen /= np.maximum(np.linalg.norm(seen, axis=2, keepdims=True), 1e-300)
    return np.log(np.linalg.norm(seen - rays, axis=2) + _FINE).mean(axis=1)


def _placed(camera: Camera, pose: np.ndarray) -> Camera:
    whole = np.eye(4)
    whole[:3] = pose
    return replace(camera, camera_from_world=whole)


def _lengths(camera: Camera, points_m: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    seen, codes = camera.project(points_m)
    far = float(np.hypot(*camera.size_px))
    return np.where(codes == 0, np.minimum(np.linalg.norm(seen - pixels, axis=1), far), far)


def _cost(camera: Camera, points_m: np.ndarray, pixels: np.ndarray) -> float:
    """The mean logarithm of the distances: no scale has to be known, and what is far off counts little more."""
    return float(np.log(_lengths(camera, points_m, pixels) + 1e-3 * camera.size_px[0]).mean())


def _refined(camera: Camera, points_m: np.ndarray, pixels: np.ndarray, freedom: np.ndarray) -> Camera:
    """Gauss-Newton on the free numbers of the camera, the noise found anew with every step."""
    n = len(points_m)
    index = np.arange(n)
    seen = Sightings(np.zeros(n, dtype=np.int64), index, pixels, np.ones(n), points_m, index, index)
    rig = CameraRig((camera,))
    for _ in range(_STEPS):
        rows = rows_of(rig, seen, points_m, np.ones(1))
        scale = max(float(np.median(np.sqrt(rows.squared))) / _MEDIAN_LENGTH, 1e-6)
        weight = (NU + 2.0) / (NU + rows.squared / scale**2)
        by_camera = rows.by_camera[:, :, freedom]
        matrix = np.einsum("n,nij,nik->jk", weight, by_camera, by_camera)
        matrix[np.diag_indices_from(matrix)] *= 1.0 + 1e-6
        step = np.linalg.lstsq(matrix, -np.einsum("n,nij,ni->j", weight, by_camera, rows.residual), rcond=1e-14)[0]
        change = np.zeros((1, N_PARAMETERS))
        change[0, freedom] = step * min(1.0, 0.3 / max(float(np.abs(np.delete(step, [3, 4, 5])).max()), 1e-12))
        rig = changed(rig, change)
        if np.abs(step).max() < 1e-9:
            break
    return rig.cameras[0]
