"""Triangulation, one point at a time: maximum likelihood by SciPy, through the full lens model."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from posefuse.model.cameras import Camera
from tests.reference import lens


def linear_point(cameras: Sequence[Camera], rays: np.ndarray) -> np.ndarray:
    """Return the point of ray directions (view, 3) in camera coordinates, by direct linear transformation."""
    rows = []
    for camera, (x, y, z) in zip(cameras, rays, strict=True):
        r0, r1, r2 = camera.camera_from_world[:3]
        rows += [x * r2 - z * r0, y * r2 - z * r1]
    homogeneous = np.linalg.svd(np.array(rows))[2][-1]
    return homogeneous[:3] / homogeneous[3]


def maximum_likelihood_point(
    cameras: Sequence[Camera], pixels: np.ndarray, sigma_px: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the maximum-likelihood point of pixels (view, 2) with independent Gaussian errors, and its covariance."""

    def residuals(point: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [
                (lens.project(camera, point) - pixel) / sigma
                for camera, pixel, sigma in zip(cameras, pixels, sigma_px, strict=True)
            ]
        )

    actual = least_squares(residuals, start, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    jacobian = np.stack([_derivative(residuals, actual.x, axis) for axis in range(3)], axis=1)
    return actual.x, np.linalg.inv(jacobian.T @ jacobian)


def _derivative(function, at: np.ndarray, axis: int, step: float = 1e-6) -> np.ndarray:
    high, low = at.copy(), at.copy()
    high[axis] += step
    low[axis] -= step
    return (function(high) - function(low)) / (2 * step)


def intersect_rays(origins: np.ndarray, directions: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the point closest to lines through ``origins`` (view, 3) along unit ``directions`` (view, 3)."""
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for origin, direction, weight in zip(origins, directions, weights, strict=True):
        across = np.eye(3) - np.outer(direction, direction)
        normal += weight * across
        right += weight * across @ origin
    return np.linalg.solve(normal, right)
