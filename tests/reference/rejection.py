"""FreeMoCap's outlier rejection methods, one point at a time: by its documentation, and by its program's rules."""

from itertools import combinations

import numpy as np

from posefuse.model.cameras import CameraRig
from tests.reference import lens
from tests.reference.points import linear_point, maximum_likelihood_point


def point_of(rig: CameraRig, pixels: np.ndarray, views: list[int]) -> np.ndarray:
    """Return the maximum-likelihood point of the views."""
    cameras = [rig.cameras[v] for v in views]
    rays = np.stack([lens.ray(camera, pixels[v], np.inf) for v, camera in zip(views, cameras, strict=True)])
    start = linear_point(cameras, rays)
    return maximum_likelihood_point(cameras, pixels[views], np.ones(len(views)), start)[0]


def errors_of(rig: CameraRig, pixels: np.ndarray, views: list[int], point: np.ndarray) -> list[float]:
    """Return the reprojection error in each view, px."""
    return [float(np.linalg.norm(lens.project(rig.cameras[v], point) - pixels[v])) for v in views]


def weighted_subsets(rig: CameraRig, pixels: np.ndarray, target: float, max_drop: int, min_views: int) -> np.ndarray:
    """Return the point of ``pixels`` (view, 2), which are NaN where missing."""
    views = [v for v in range(len(rig)) if np.isfinite(pixels[v]).all()]
    if len(views) < min_views:
        return np.full(3, np.nan)
    initial = point_of(rig, pixels, views)
    initial_error = np.mean(errors_of(rig, pixels, views, initial))
    if initial_error <= target:
        return initial
    tested = []
    for dropped in range(1, max_drop + 1):
        if len(views) - dropped < min_views:
            break
        for kept in combinations(views, len(views) - dropped):
            point = point_of(rig, pixels, list(kept))
            if any(rig.cameras[v].rotation[2] @ point + rig.cameras[v].translation_m[2] <= 0 for v in kept):
                continue  # the rays do not meet in front of the cameras: no point
            tested.append((float(np.mean(errors_of(rig, pixels, list(kept), point))), point))
        if min(error for error, _ in tested) < target:
            break
    if not tested:
        return initial
    exponents = np.array([-5.0 * error / target for error, _ in tested])
    weights = np.exp(exponents - exponents.max())
    weighted = (weights[:, None] * np.array([point for _, point in tested])).sum(axis=0) / weights.sum()
    if min(error for error, _ in tested) < target:
        return weighted
    weighted_error = np.mean(errors_of(rig, pixels, views, weighted))
    return weighted if weighted_error < initial_error else initial


def percentile_filter(rig: CameraRig, pixels: np.ndarray, threshold_px: float, min_views: int) -> np.ndarray:
    """Return the point of ``pixels`` (view, 2); NaN if its errors remain too large."""
    views = [v for v in range(len(rig)) if np.isfinite(pixels[v]).all()]
    if len(views) < min_views:
        return np.full(3, np.nan)
    while True:
        point = point_of(rig, pixels, views)
        errors = errors_of(rig, pixels, views, point)
        if max(errors) <= threshold_px:
            return point
        if len(views) <= min_views:
            return np.full(3, np.nan)
        del views[int(np.argmax(errors))]


def undistorted(rig: CameraRig, pixels: np.ndarray, views: list[int]) -> np.ndarray:
    """Return the rays of pixels (view, 2) at depth 1, shape (view, 3)."""
    rays = np.stack([lens.ray(rig.cameras[v], pixels[v], np.inf) for v in views])
    return rays / rays[:, 2:]


def program_point(rig: CameraRig, pixels: np.ndarray, views: list[int]) -> np.ndarray:
    """Return the linear point of the views; lengths are in meters."""
    return linear_point([rig.cameras[v] for v in views], undistorted(rig, pixels, views))


def program_weighted_subsets(
    rig: CameraRig, pixels: np.ndarray, target: float, max_drop: int, min_views: int
) -> np.ndarray:
    """Return the point of ``pixels`` (view, 2) by the rules of FreeMoCap 1.8.2; the target is in focal lengths."""

    def mean_error(point: np.ndarray, kept: tuple[int, ...] | list[int]) -> float:
        rays = undistorted(rig, pixels, list(kept))
        poses = [rig.cameras[v] for v in kept]
        local = np.array([camera.rotation @ point + camera.translation_m for camera in poses])
        return float(np.mean(np.linalg.norm(local[:, :2] / local[:, 2:] - rays[:, :2], axis=1)))

    views = [v for v in range(len(rig)) if np.isfinite(pixels[v]).all()]
    if len(views) < min_views:
        return np.full(3, np.nan)
    initial = program_point(rig, pixels, views)
    initial_error = mean_error(initial, views)
    if initial_error < target:
        return initial
    points, errors = [initial], [initial_error]
    for dropped in range(1, max_drop + 1):
        if len(views) - dropped < min_views:
            break
        for kept in combinations(views, len(views) - dropped):
            points.append(program_point(rig, pixels, list(kept)))
            errors.append(mean_error(points[-1], kept))
        if min(errors[1:]) < target:
            break
    if min(errors[1:], default=np.inf) >= initial_error:
        return initial
    weights = np.exp(-5.0 * np.array(errors) / target)
    if weights.sum() <= 1e-12:
        return points[1 + int(np.argmin(errors[1:]))]
    return (weights[:, None] * np.array(points)).sum(axis=0) / weights.sum()


def program_percentile_filter(rig: CameraRig, pixels: np.ndarray, percentile: float, min_left: int) -> np.ndarray:
    """Return the points of ``pixels`` (point, view, 2) by the rules of FreeMoCap 1.7.4, NaN where it has none."""
    seen = [[v for v in range(len(rig)) if np.isfinite(each[v]).all()] for each in pixels]
    points = np.full((len(pixels), 3), np.nan)
    errors = [[] for _ in pixels]
    for i, views in enumerate(seen):
        if len(views) > 1:
            points[i] = program_point(rig, pixels[i], views)
            errors[i] = errors_of(rig, pixels[i], views, points[i])
    threshold = np.percentile([np.mean(each) for each in errors if each], percentile, method="weibull")
    for i, views in enumerate(seen):
        while errors[i] and max(errors[i]) > threshold:
            if len(views) <= min_left:
                points[i] = np.nan
                break
            del views[int(np.argmax(errors[i]))]
            points[i] = program_point(rig, pixels[i], views)
            errors[i] = errors_of(rig, pixels[i], views, points[i])
    return points
