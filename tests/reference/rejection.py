"""FreeMoCap's two outlier rejection methods, one point at a time, implemented from its documentation."""

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
