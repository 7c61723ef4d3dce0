"""Lens models: projection of points in camera coordinates to pixels and back, with derivatives and domain checks.

The four lens models share one signature. Camera coordinates follow OpenCV (x right, y down, z forward). Pixel (0, 0) is
the center of the top-left pixel. With ``(x, y) = (X/Z, Y/Z)`` and ``s = x^2 + y^2``:

* pinhole: ``(x, y)`` unchanged;
* Brown-Conrady, 5 coefficients, and rational, 8 coefficients (k1 k2 p1 p2 k3 k4 k5 k6):
  ``x_d = x (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3) + 2 p1 x y + p2 (s + 2 x^2)``, and ``y_d``
  accordingly (OpenCV, "Camera Calibration and 3D Reconstruction");
* fisheye, 4 coefficients: ``theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)`` along the
  direction of ``(X, Y)``, where theta is the angle from the optical axis (Kannala & Brandt 2006). Angles beyond 90
  degrees are valid.

The pixel is ``K (x_d, y_d, 1)``.

A distortion polynomial folds over: beyond some radius, points farther out map farther in. ``MAX_RADIUS`` is the start
of the fold (a radius in the plane z = 1, or an angle in radians for the fisheye). Beyond it, both directions return a
status and NaN.

Kernels take the cameras of a rig as one float64 array with one row per camera, and a row number ``v``, because slicing
out a row would cost more than the projection. The constants below name the columns.
"""

import math

import numpy as np

from posefuse.kernels.jit import inline, kernel, subroutine

PINHOLE = 0
BROWN = 1
RATIONAL = 2
FISHEYE = 3

# Columns of the camera array.
LENS = 0
FX = 1
FY = 2
CX = 3
CY = 4
SKEW = 5
K1 = 6
K2 = 7
P1 = 8
"""The fisheye model stores k3 here."""
P2 = 9
"""The fisheye model stores k4 here."""
K3 = 10
K4 = 11
K5 = 12
K6 = 13
MAX_RADIUS = 14
ROTATION = 15
"""Nine numbers of camera_from_world in row-major order; the translation follows."""
TRANSLATION = 24
PROJECTION = 27
"""The first two rows of K camera_from_world, four numbers each (the third row is that of camera_from_world)."""
COLUMNS = 35

OK = 0
MISSING = 1
"""The input is NaN or infinite."""
BEHIND = 2
"""The point lies behind the camera or at its center."""
BEYOND = 3
"""The point or pixel lies beyond the radius where the lens model folds over."""

_MAX_NEWTON = 40
# Newton converges quadratically here: a step this small leaves an error far below a rounding error of a pixel.
SMALL_STEP_SQUARED = 1e-15


@inline
def distort(cameras, v, x, y):
    """Distort ``(x, y)`` in the plane z = 1 (pinhole, Brown-Conrady, rational).

    Returns:
        ``(x_d, y_d, a, b, c, d)``: the distorted point and its derivative ``[[a, b], [c, d]]``.
    """
    lens = cameras[v, LENS]
    if lens == PINHOLE:
        return x, y, 1.0, 0.0, 0.0, 1.0
    k1 = cameras[v, K1]
    k2 = cameras[v, K2]
    k3 = cameras[v, K3]
    p1 = cameras[v, P1]
    p2 = cameras[v, P2]
    s = x * x + y * y
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    slope = k1 + s * (2.0 * k2 + s * 3.0 * k3)
    if lens == RATIONAL:
        k4 = cameras[v, K4]
        k5 = cameras[v, K5]
        k6 = cameras[v, K6]
        denominator = 1.0 + s * (k4 + s * (k5 + s * k6))
        radial /= denominator
        slope = (slope - radial * (k4 + s * (2.0 * k5 + s * 3.0 * k6))) / denominator
    x_d = x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x)
    y_d = y * radial + 2.0 * p2 * x * y + p1 * (s + 2.0 * y * y)
    cross = 2.0 * x * y * slope + 2.0 * (p1 * x + p2 * y)
    a = radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    d = radial + 2.0 * y * y * slope + 2.0 * p2 * x + 6.0 * p1 * y
    return x_d, y_d, a, cross, cross, d


@subroutine
def fisheye_radius(cameras, v, theta):
    """Return the image radius at an angle from the optical axis, and its derivative."""
    k1 = cameras[v, K1]
    k2 = cameras[v, K2]
    k3 = cameras[v, P1]
    k4 = cameras[v, P2]
    q = theta * theta
    radius = theta * (1.0 + q * (k1 + q * (k2 + q * (k3 + q * k4))))
    slope = 1.0 + q * (3.0 * k1 + q * (5.0 * k2 + q * (7.0 * k3 + q * 9.0 * k4)))
    return radius, slope


@subroutine
def _fisheye_jacobian(cameras, v, x, y, z):
    """Return the derivative of the distorted point with respect to the point in camera coordinates, row by row."""
    rho = math.sqrt(x * x + y * y)
    if rho < 1e-9 * abs(z):
        return 1.0 / z, 0.0, -x / (z * z), 0.0, 1.0 / z, -y / (z * z)
    radius, slope = fisheye_radius(cameras, v, math.atan2(rho, z))
    cos = x / rho
    sin = y / rho
    # Radially the angle changes by (z d_rho - rho dz) / norm^2; tangentially the point rotates by d_tangent / rho.
    norm_squared = rho * rho + z * z
    radial_by_rho = slope * z / norm_squared
    radial_by_z = -slope * rho / norm_squared
    across = radius / rho
    xx = cos * cos * radial_by_rho + sin * sin * across
    xy = cos * sin * (radial_by_rho - across)
    yy = sin * sin * radial_by_rho + cos * cos * across
    return xx, xy, cos * radial_by_z, xy, yy, sin * radial_by_z


@inline
def to_camera(cameras, v, x, y, z):
    """Transform a world point to the coordinates of camera ``v``."""
    r = ROTATION
    t = TRANSLATION
    return (
        cameras[v, r] * x + cameras[v, r + 1] * y + cameras[v, r + 2] * z + cameras[v, t],
        cameras[v, r + 3] * x + cameras[v, r + 4] * y + cameras[v, r + 5] * z + cameras[v, t + 1],
        cameras[v, r + 6] * x + cameras[v, r + 7] * y + cameras[v, r + 8] * z + cameras[v, t + 2],
    )


@inline
def project_point(cameras, v, x, y, z):
    """Project a point in camera coordinates.

    Returns:
        ``(status, u, v)``; the pixel is NaN unless the status is OK.
    """
    nan = math.nan
    if not math.isfinite(x + y + z):
        return MISSING, nan, nan
    if cameras[v, LENS] == FISHEYE:
        rho = math.sqrt(x * x + y * y)
        if rho == 0.0 and z <= 0.0:
            return BEHIND, nan, nan
        theta = math.atan2(rho, z)
        if theta > cameras[v, MAX_RADIUS]:
            return BEYOND, nan, nan
        radius, _ = fisheye_radius(cameras, v, theta)
        scale = radius / rho if rho > 0.0 else 0.0
        x_d = scale * x
        y_d = scale * y
    else:
        if z <= 0.0:
            return BEHIND, nan, nan
        inverse = 1.0 / z
        x_n = x * inverse
        y_n = y * inverse
        x_d, y_d, a, b, c, d = distort(cameras, v, x_n, y_n)
        # MAX_RADIUS considers radial terms only; strong tangential terms fold slightly earlier on one side.
        if x_n * x_n + y_n * y_n > cameras[v, MAX_RADIUS] ** 2 or not a * d - b * c > 0.0:
            return BEYOND, nan, nan
    return (
        OK,
        cameras[v, FX] * x_d + cameras[v, SKEW] * y_d + cameras[v, CX],
        cameras[v, FY] * y_d + cameras[v, CY],
    )


@subroutine
def project_jacobian(cameras, v, x, y, z):
    """Return the derivative of the pixel with respect to the point in camera coordinates.

    Returns:
        ``(status, u_x, u_y, u_z, v_x, v_y, v_z)`` in px per unit of the point; NaN unless the status is OK.
    """
    nan = math.nan
    status, _, _ = project_point(cameras, v, x, y, z)
    if status != OK:
        return status, nan, nan, nan, nan, nan, nan
    if cameras[v, LENS] == FISHEYE:
        xx, xy, xz, yx, yy, yz = _fisheye_jacobian(cameras, v, x, y, z)
    else:
        x_n = x / z
        y_n = y / z
        _, _, a, b, c, d = distort(cameras, v, x_n, y_n)
        xx = a / z
        xy = b / z
        xz = -(a * x_n + b * y_n) / z
        yx = c / z
        yy = d / z
        yz = -(c * x_n + d * y_n) / z
    fx = cameras[v, FX]
    fy = cameras[v, FY]
    skew = cameras[v, SKEW]
    return status, fx * xx + skew * yx, fx * xy + skew * yy, fx * xz + skew * yz, fy * yx, fy * yy, fy * yz


@subroutine
def _newton_undistort(cameras, v, x_d, y_d, x, y):
    """Solve distort(x, y) = (x_d, y_d) by Newton's method; return (converged, x, y, derivative at x, y)."""
    a = 1.0
    b = 0.0
    c = 0.0
    d = 1.0
    for _ in range(_MAX_NEWTON):
        f_x, f_y, a, b, c, d = distort(cameras, v, x, y)
        determinant = a * d - b * c
        if not determinant > 0.0:
            return False, x, y, a, b, c, d
        inverse = 1.0 / determinant
        r_x = x_d - f_x
        r_y = y_d - f_y
        step_x = (d * r_x - b * r_y) * inverse
        step_y = (a * r_y - c * r_x) * inverse
        x += step_x
        y += step_y
        if step_x * step_x + step_y * step_y < SMALL_STEP_SQUARED:
            return True, x, y, a, b, c, d
    return False, x, y, a, b, c, d


@subroutine
def _radial_image(cameras, v, radius):
    """Return the image radius of a radius in the plane z = 1, without tangential terms."""
    s = radius * radius
    radial = 1.0 + s * (cameras[v, K1] + s * (cameras[v, K2] + s * cameras[v, K3]))
    if cameras[v, LENS] == RATIONAL:
        radial /= 1.0 + s * (cameras[v, K4] + s * (cameras[v, K5] + s * cameras[v, K6]))
    return radius * radial


@subroutine
def _radial_start(cameras, v, image_radius):
    """Return the radius in the plane z = 1 of an image radius, by bisection; the fold radius if there is none."""
    low = 0.0
    high = cameras[v, MAX_RADIUS]
    if not math.isfinite(high):
        high = max(1.0, image_radius)
        while _radial_image(cameras, v, high) < image_radius and high < 1e6:
            high *= 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _radial_image(cameras, v, middle) < image_radius:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@inline
def undistort_normalized(cameras, v, x_d, y_d):
    """Invert the distortion of a point in the plane z = 1 (pinhole, Brown-Conrady, rational).

    Returns:
        ``(status, x, y, a, b, c, d)``: the undistorted point and ``[[a, b], [c, d]]``, the derivative of the distorted
        point with respect to it; NaN unless the status is OK.
    """
    nan = math.nan
    if not math.isfinite(x_d + y_d):
        return MISSING, nan, nan, nan, nan, nan, nan
    if cameras[v, LENS] == PINHOLE:
        return OK, x_d, y_d, 1.0, 0.0, 0.0, 1.0
    limit = cameras[v, MAX_RADIUS] ** 2
    converged, x, y, a, b, c, d = _newton_undistort(cameras, v, x_d, y_d, x_d, y_d)
    if not converged or x * x + y * y > limit:
        # With strong distortion, Newton may leave the domain when started at the distorted point.
        image_radius = math.sqrt(x_d * x_d + y_d * y_d)
        start = _radial_start(cameras, v, image_radius) / image_radius
        converged, x, y, a, b, c, d = _newton_undistort(cameras, v, x_d, y_d, start * x_d, start * y_d)
        if not converged or x * x + y * y > limit:
            return BEYOND, nan, nan, nan, nan, nan, nan
    return OK, x, y, a, b, c, d


@subroutine
def fisheye_angle(cameras, v, radius):
    """Return the angle from the axis at an image radius, by safeguarded Newton; NaN beyond the fold."""
    low = 0.0
    high = cameras[v, MAX_RADIUS]
    max_image_radius, _ = fisheye_radius(cameras, v, high)
    if not radius <= max_image_radius:
        return math.nan
    theta = min(radius, high)
    for _ in range(_MAX_NEWTON):
        value, slope = fisheye_radius(cameras, v, theta)
        if value < radius:
            low = theta
        else:
            high = theta
        next_theta = theta + (radius - value) / slope
        if not (low <= next_theta <= high):
            next_theta = 0.5 * (low + high)
        change = next_theta - theta
        theta = next_theta
        if change * change < SMALL_STEP_SQUARED:
            break
    return theta


@inline
def angle_code(radius, theta):
    """Return the status of a fisheye pixel from its image radius and its computed angle."""
    if not math.isfinite(radius):
        return MISSING
    return OK if math.isfinite(theta) else BEYOND


@subroutine
def pixel_to_ray(cameras, v, pixel_u, pixel_v):
    """Return the viewing direction of a pixel in camera coordinates.

    Returns:
        ``(status, x, y, z)``: a unit vector for the fisheye, otherwise scaled to z = 1; NaN unless the status is OK.
    """
    nan = math.nan
    y_d = (pixel_v - cameras[v, CY]) / cameras[v, FY]
    x_d = (pixel_u - cameras[v, CX] - cameras[v, SKEW] * y_d) / cameras[v, FX]
    if cameras[v, LENS] == FISHEYE:
        radius = math.sqrt(x_d * x_d + y_d * y_d)
        theta = fisheye_angle(cameras, v, radius)
        status = angle_code(radius, theta)
        if status != OK:
            return status, nan, nan, nan
        scale = math.sin(theta) / radius if radius > 0.0 else 1.0
        return OK, scale * x_d, scale * y_d, math.cos(theta)
    status, x, y, _, _, _, _ = undistort_normalized(cameras, v, x_d, y_d)
    return status, x, y, 1.0 if status == OK else nan


@kernel
def project_batch(cameras, v, points, pixels, status):
    """Project world points, shape (n, 3), through camera ``v``; write ``pixels`` (n, 2) and ``status`` (n,)."""
    for n in range(points.shape[0]):
        x, y, z = to_camera(cameras, v, points[n, 0], points[n, 1], points[n, 2])
        status[n], pixels[n, 0], pixels[n, 1] = project_point(cameras, v, x, y, z)


@kernel
def rays_batch(cameras, v, pixels, directions, status):
    """Write unit viewing directions (n, 3) in camera coordinates, and status (n,), of pixels (n, 2)."""
    for n in range(pixels.shape[0]):
        status[n], x, y, z = pixel_to_ray(cameras, v, pixels[n, 0], pixels[n, 1])
        norm = math.sqrt(x * x + y * y + z * z)
        directions[n, 0] = x / norm
        directions[n, 1] = y / norm
        directions[n, 2] = z / norm


def fold_radius(lens: int, coefficients: np.ndarray) -> float:
    """Return the fold of a lens model: the least radius (fisheye: angle) at which the image radius stops growing.

    Args:
        lens: the lens code.
        coefficients: shape (8,), in the order of the columns from K1 on.

    Returns:
        A radius in the plane z = 1, or an angle in radians for the fisheye (at most pi); inf if the model never folds.
    """
    k = coefficients
    if lens == PINHOLE:
        return math.inf
    if lens == FISHEYE:
        slope = np.array([1.0, 3 * k[0], 5 * k[1], 7 * k[2], 9 * k[3]])
        return min(_smallest_positive_root(slope), math.pi)
    numerator = np.array([1.0, k[0], k[1], k[4]])
    denominator = np.array([1.0, k[5], k[6], k[7]])
    powers = np.arange(1, 4)
    # d/dr [r N(s) / D(s)] with s = r^2 has the sign of N D + 2 s (N' D - N D').
    change = np.convolve(numerator[1:] * powers, denominator) - np.convolve(numerator, denominator[1:] * powers)
    slope = np.convolve(numerator, denominator) + np.append(0.0, 2.0 * change)
    return min(_smallest_positive_root(slope), _smallest_positive_root(denominator))


def _smallest_positive_root(ascending: np.ndarray) -> float:
    """Return the root of the smallest positive real zero of a polynomial in s = r^2 (ascending); else inf."""
    roots = np.polynomial.polynomial.polyroots(np.trim_zeros(ascending, "b"))
    real = roots[np.abs(roots.imag) < 1e-9 * np.maximum(1.0, np.abs(roots))].real
    positive = real[real > 0.0]
    return float(np.sqrt(positive.min())) if positive.size else math.inf
