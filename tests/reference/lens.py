"""Lens models, one point at a time, directly from the formulas."""

import numpy as np
from scipy.optimize import brentq, least_squares

from posefuse.model.cameras import Camera, LensModel


def distort(camera: Camera, x: float, y: float) -> tuple[float, float]:
    k1, k2, p1, p2, k3, k4, k5, k6 = (camera.distortion + (0.0,) * 8)[:8]
    s = x * x + y * y
    radial = (1 + k1 * s + k2 * s**2 + k3 * s**3) / (1 + k4 * s + k5 * s**2 + k6 * s**3)
    return (
        x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x),
        y * radial + 2 * p2 * x * y + p1 * (s + 2 * y * y),
    )


def fisheye_radius(camera: Camera, theta: float) -> float:
    k1, k2, k3, k4 = camera.distortion
    return theta * (1 + k1 * theta**2 + k2 * theta**4 + k3 * theta**6 + k4 * theta**8)


def project(camera: Camera, point_m: np.ndarray) -> np.ndarray:
    """Project a world point to a pixel, without a domain check."""
    x, y, z = camera.rotation @ point_m + camera.translation_m
    if camera.lens is LensModel.FISHEYE:
        rho = np.hypot(x, y)
        radius = fisheye_radius(camera, np.arctan2(rho, z))
        x_d, y_d = (radius * x / rho, radius * y / rho) if rho > 0 else (0.0, 0.0)
    else:
        x_d, y_d = distort(camera, x / z, y / z)
    return (camera.matrix @ [x_d, y_d, 1.0])[:2]


def ray(camera: Camera, pixel: np.ndarray, max_radius: float) -> np.ndarray:
    """Return the unit viewing direction of a pixel in camera coordinates, by bracketing and least squares."""
    x_d, y_d, _ = np.linalg.solve(camera.matrix, [*pixel, 1.0])
    if camera.lens is LensModel.FISHEYE:
        radius = np.hypot(x_d, y_d)
        theta = brentq(lambda t: fisheye_radius(camera, t) - radius, 0.0, max_radius, xtol=1e-14)
        across = np.sin(theta) / radius if radius > 0 else 0.0
        return np.array([across * x_d, across * y_d, np.cos(theta)])
    actual = least_squares(
        lambda xy: np.subtract(distort(camera, *xy), (x_d, y_d)), (x_d, y_d), xtol=1e-15, ftol=1e-15, gtol=1e-15
    ).x
    direction = np.array([*actual, 1.0])
    return direction / np.linalg.norm(direction)


def fold_radius(camera: Camera, furthest: float) -> float:
    """Return the radius where the image radius stops growing, by a radial scan; inf if it grows up to ``furthest``."""
    radii = np.linspace(0.0, furthest, 200_001)
    if camera.lens is LensModel.FISHEYE:
        image = np.array(fisheye_radius(camera, radii))
    else:
        k1, k2, _, _, k3, k4, k5, k6 = (camera.distortion + (0.0,) * 8)[:8]
        s = radii**2
        denominator = 1 + k4 * s + k5 * s**2 + k6 * s**3
        image = radii * (1 + k1 * s + k2 * s**2 + k3 * s**3) / denominator
        image[np.maximum.accumulate(denominator <= 0)] = -1e9
    falling = np.diff(image) <= 0
    return float(radii[np.argmax(falling)]) if falling.any() else float("inf")
