"""Lenses: from a point in camera coordinates to a pixel and back, with derivatives and an honest domain.

Four lens models share one signature. Camera coordinates are OpenCV's (x right, y down, z forward); pixel (0, 0) is
the centre of the top-left pixel. With ``(x, y) = (X/Z, Y/Z)`` and ``s = x^2 + y^2``:

* pinhole: ``(x, y)`` unchanged;
* Brown-Conrady, 5 coefficients, and rational, 8 coefficients (k1 k2 p1 p2 k3 k4 k5 k6):
  ``x_d = x (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3) + 2 p1 x y + p2 (s + 2 x^2)``, and the like for
  ``y_d`` (OpenCV, "Camera Calibration and 3D Reconstruction");
* fisheye, 4 coefficients: ``theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)`` along the
  direction of ``(X, Y)``, theta the angle from the optical axis (Kannala & Brandt 2006). Angles past 90 degrees are
  fine.

The pixel is ``K (x_d, y_d, 1)``.

A distortion polynomial folds over: from some radius on, points further out land further in. ``MAX_RADIUS`` is where
that begins (a radius in the plane z = 1, or an angle in radians for the fisheye). Past it, both directions return
a status and NaN, never a number.

Kernels see the cameras of a rig as one float64 array, a row a camera, and a row number ``v``: slicing a row out would
cost more than the projection. The columns are named below.
"""

import math

import numpy as np

from posefuse.kernels.jit import inline, kernel, step

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
"""k3 of the fisheye."""
P2 = 9
"""k4 of the fisheye."""
K3 = 10
K4 = 11
K5 = 12
K6 = 13
MAX_RADIUS = 14
ROTATION = 15
"""Nine numbers of camera_from_world, row by row; the translation follows."""
TRANSLATION = 24
PROJECTION = 27
"""The first two rows of K camera_from_world, four numbers each (the third is camera_from_world's own)."""
COLUMNS = 35

OK = 0
MISSING = 1
"""The input is NaN or infinite."""
BEHIND = 2
"""The point lies behind the camera, or in its centre."""
BEYOND = 3
"""Past the radius where the lens model folds over: no such pixel, or no such point."""

_MAX_NEWTON = 40
# Newton converges quadratically here: a step this small leaves an error far below a rounding error of a pixel.
SMALL_STEP_SQUARED = 1e-15


@inline
def distort(cameras, v, x, y):
    """Distort ``(x, y)`` of the plane z = 1 (pinhole, Brown, rational).

    Returns:
        ``(x_d, y_d, a, b, c, d)``, the distorted point and its derivative ``[[a, b], [c, d]]``.
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


@step
def fisheye_radius(cameras, v, theta):
    """The image radius of an angle from the axis, and its derivative."""
    k1 = cameras[v, K1]
    k2 = cameras[v, K2]
    k3 = cameras[v, P1]
    k4 = cameras[v, P2]
    q = theta * theta
    radius = theta * (1.0 + q * (k1 + q * (k2 + q * (k3 + q * k4))))
    slope = 1.0 + q * (3.0 * k1 + q * (5.0 * k2 + q * (7.0 * k3 + q * 9.0 * k4)))
    return radius, slope


@step
def _fisheye_jacobian(cameras, v, x, y, z):
    """Derivative of the distorted point with respect to the point in camera coordinates, row by row."""
    rho = math.sqrt(x * x + y * y)
    if rho < 1e-9 * abs(z):
        return 1.0 / z, 0.0, -x / (z * z), 0.0, 1.0 / z, -y / (z * z)
    radius, slope = fisheye_radius(cameras, v, math.atan2(rho, z))
    cos = x / rho
    sin = y / rho
    # Along the radius the angle changes by (z d_rho - rho dz) / norm^2; across it the point turns by d_across / rho.
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
    """A world point in the coordinates of camera ``v``."""
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
        ``(status, u, v)``; NaN pixels unless the status is OK.
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
        # The radius is that of the radial terms; strong tangential ones fold a little earlier on one side.
        if x_n * x_n + y_n * y_n > cameras[v, MAX_RADIUS] ** 2 or not a * d - b * c > 0.0:
            return BEYOND, nan, nan
    return (
        OK,
        cameras[v, FX] * x_d + cameras[v, SKEW] * y_d + cameras[v, CX],
        cameras[v, FY] * y_d + cameras[v, CY],
    )


@step
def project_jacobian(cameras, v, x, y, z):
    """The derivative of the pixel with respect to the point in camera coordinates.

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


@step
def _newton_undistort(cameras, v, x_d, y_d, x, y):
    """Solve distort(x, y) = (x_d, y_d) from a start. Returns (converged, x, y, and the derivative there)."""
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


@step
def _radial_image(cameras, v, radius):
    """The image radius of a radius in the plane z = 1, tangential terms left out."""
    s = radius * radius
    radial = 1.0 + s * (cameras[v, K1] + s * (cameras[v, K2] + s * cameras[v, K3]))
    if cameras[v, LENS] == RATIONAL:
        radial /= 1.0 + s * (cameras[v, K4] + s * (cameras[v, K5] + s * cameras[v, K6]))
    return radius * radial


@step
def _radial_start(cameras, v, r_d):
    """The radius in the plane z = 1 of an image radius, by bisection; the fold where there is none."""
    low = 0.0
    high = cameras[v, MAX_RADIUS]
    if not math.isfinite(high):
        high = max(1.0, r_d)
        while _radial_image(cameras, v, high) < r_d and high < 1e6:
            high *= 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _radial_image(cameras, v, middle) < r_d:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@inline
def undistort_normalised(cameras, v, x_d, y_d):
    """Undo the distortion of a point of the plane z = 1 (pinhole, Brown, rational).

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
        # Strong lenses: from the distorted point Newton may leave the domain. Start it at the right radius.
        r_d = math.sqrt(x_d * x_d + y_d * y_d)
        start = _radial_start(cameras, v, r_d) / r_d
        converged, x, y, a, b, c, d = _newton_undistort(cameras, v, x_d, y_d, start * x_d, start * y_d)
        if not converged or x * x + y * y > limit:
            return BEYOND, nan, nan, nan, nan, nan, nan
    return OK, x, y, a, b, c, d


@step
def fisheye_angle(cameras, v, radius):
    """The angle from the axis of an image radius, by safeguarded Newton; NaN past the fold."""
    low = 0.0
    high = cameras[v, MAX_RADIUS]
    top, _ = fisheye_radius(cameras, v, high)
    if not radius <= top:
        return math.nan
    theta = min(radius, high)
    for _ in range(_MAX_NEWTON):
        value, slope = fisheye_radius(cameras, v, theta)
        if value < radius:
            low = theta
        else:
            high = theta
        new = theta + (radius - value) / slope
        if not (low <= new <= high):
            new = 0.5 * (low + high)
        change = new - theta
        theta = new
        if change * change < SMALL_STEP_SQUARED:
            break
    return theta


@inline
def angle_code(radius, theta):
    """The status of a pixel of a fisheye, from its image radius and the angle found for it."""
    if not math.isfinite(radius):
        return MISSING
    return OK if math.isfinite(theta) else BEYOND


@step
def pixel_to_ray(cameras, v, pixel_u, pixel_v):
    """The viewing direction of a pixel, in camera coordinates.

    Returns:
        ``(status, x, y, z)``: for the fisheye a unit vector, else with z = 1; NaN unless the status is OK.
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
    status, x, y, _, _, _, _ = undistort_normalised(cameras, v, x_d, y_d)
    return status, x, y, 1.0 if status == OK else nan


@kernel
def project_batch(cameras, v, points, pixels, status):
    """Project world points, shape (n, 3), through camera ``v`` into ``pixels`` (n, 2) and ``status`` (n,)."""
    for n in range(points.shape[0]):
        x, y, z = to_camera(cameras, v, points[n, 0], points[n, 1], points[n, 2])
        status[n], pixels[n, 0], pixels[n, 1] = project_point(cameras, v, x, y, z)


@kernel
def rays_batch(cameras, v, pixels, directions, status):
    """Unit viewing directions in camera coordinates of pixels (n, 2), into ``directions`` (n, 3)."""
    for n in range(pixels.shape[0]):
        status[n], x, y, z = pixel_to_ray(cameras, v, pixels[n, 0], pixels[n, 1])
        norm = math.sqrt(x * x + y * y + z * z)
        directions[n, 0] = x / norm
        directions[n, 1] = y / norm
        directions[n, 2] = z / norm


def fold_radius(lens: int, coefficients: np.ndarray) -> float:
    """Where a lens model folds over: the smallest radius (fisheye: angle) at which the image radius stops growing.

    Args:
        lens: the lens code.
        coefficients: shape (8,), in the order of the columns from K1 on.

    Returns:
        A radius in the plane z = 1, or an angle in radians for the fisheye (at most pi); inf where it never folds.
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
    """Square root of the smallest positive real root of a polynomial in s = r^2, coefficients ascending; else inf."""
    roots = np.polynomial.polynomial.polyroots(np.trim_zeros(ascending, "b"))
    real = roots[np.abs(roots.imag) < 1e-9 * np.maximum(1.0, np.abs(roots))].real
    positive = real[real > 0.0]
    return float(np.sqrt(positive.min())) if positive.size else math.inf
