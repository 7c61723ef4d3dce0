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

from posefuse.kernels.jit import inline, kernel

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

BLOCK = 32
"""Points are worked through in blocks of this many, so that the compiler can use vector instructions."""

_MAX_NEWTON = 40
_BLOCK_NEWTON = 8
# Newton converges quadratically here: a step this small leaves an error far below a rounding error of a pixel.
_SMALL_STEP_SQUARED = 1e-15


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


@kernel
def _fisheye_radius(cameras, v, theta):
    """The image radius of an angle from the axis, and its derivative."""
    k1 = cameras[v, K1]
    k2 = cameras[v, K2]
    k3 = cameras[v, P1]
    k4 = cameras[v, P2]
    q = theta * theta
    radius = theta * (1.0 + q * (k1 + q * (k2 + q * (k3 + q * k4))))
    slope = 1.0 + q * (3.0 * k1 + q * (5.0 * k2 + q * (7.0 * k3 + q * 9.0 * k4)))
    return radius, slope


@kernel
def _fisheye_jacobian(cameras, v, x, y, z):
    """Derivative of the distorted point with respect to the point in camera coordinates, row by row."""
    rho = math.sqrt(x * x + y * y)
    if rho < 1e-9 * abs(z):
        return 1.0 / z, 0.0, -x / (z * z), 0.0, 1.0 / z, -y / (z * z)
    radius, slope = _fisheye_radius(cameras, v, math.atan2(rho, z))
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
        radius, _ = _fisheye_radius(cameras, v, theta)
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


@kernel
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


@kernel
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
        if step_x * step_x + step_y * step_y < _SMALL_STEP_SQUARED:
            return True, x, y, a, b, c, d
    return False, x, y, a, b, c, d


@kernel
def _radial_image(cameras, v, radius):
    """The image radius of a radius in the plane z = 1, tangential terms left out."""
    s = radius * radius
    radial = 1.0 + s * (cameras[v, K1] + s * (cameras[v, K2] + s * cameras[v, K3]))
    if cameras[v, LENS] == RATIONAL:
        radial /= 1.0 + s * (cameras[v, K4] + s * (cameras[v, K5] + s * cameras[v, K6]))
    return radius * radial


@kernel
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


@kernel
def _fisheye_angle(cameras, v, radius):
    """The angle from the axis of an image radius, by safeguarded Newton; NaN past the fold."""
    low = 0.0
    high = cameras[v, MAX_RADIUS]
    top, _ = _fisheye_radius(cameras, v, high)
    if not radius <= top:
        return math.nan
    theta = min(radius, high)
    for _ in range(_MAX_NEWTON):
        value, slope = _fisheye_radius(cameras, v, theta)
        if value < radius:
            low = theta
        else:
            high = theta
        new = theta + (radius - value) / slope
        if not (low <= new <= high):
            new = 0.5 * (low + high)
        change = new - theta
        theta = new
        if change * change < _SMALL_STEP_SQUARED:
            break
    return theta


@inline
def _angle_code(radius, theta):
    if not math.isfinite(radius):
        return MISSING
    return OK if math.isfinite(theta) else BEYOND


@kernel
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
        theta = _fisheye_angle(cameras, v, radius)
        status = _angle_code(radius, theta)
        if status != OK:
            return status, nan, nan, nan
        scale = math.sin(theta) / radius if radius > 0.0 else 1.0
        return OK, scale * x_d, scale * y_d, math.cos(theta)
    status, x, y, _, _, _, _ = undistort_normalised(cameras, v, x_d, y_d)
    return status, x, y, 1.0 if status == OK else nan


@inline
def rows_block(cameras, v, pixels, codes, rows, scratch):
    """Turn a block of pixels of one view into the rows that make reprojection linear: what all triangulation works on.

    With ``g0, g1, c`` the rows (each of 4, acting on the homogeneous world point), the reprojection residual in true
    pixels is ``(g0.X / c.X, g1.X / c.X)``: exact without distortion, and to first order in the residual with it, the
    lens having been linearised once, at the observed pixel. ``c.X`` is the depth (for the fisheye: along the observed
    ray), positive in front of the camera. See docs/methods.md, "Observation rows".

    Args:
        cameras: the camera array.
        v: the view.
        pixels: shape (view, 2, BLOCK).
        codes: shape (view, BLOCK), written: the status of each pixel.
        rows: shape (view, 12, BLOCK), written: g0, g1, c; where the status is not OK, rows that say nothing.
        scratch: shape (6, BLOCK).
    """
    lens = cameras[v, LENS]
    if lens == PINHOLE:
        _pinhole_rows(cameras, v, pixels, codes, rows)
        return
    if lens == FISHEYE:
        _fisheye_rows(cameras, v, pixels, codes, rows)
        return
    _undistort_block(cameras, v, pixels, codes, scratch)
    for j in range(BLOCK):
        x = scratch[0, j]
        y = scratch[1, j]
        a = scratch[2, j]
        b = scratch[3, j]
        c = scratch[4, j]
        d = scratch[5, j]
        _write_rows(cameras, v, a, b, -(a * x + b * y), c, d, -(c * x + d * y), 0.0, 0.0, 1.0, rows, j)
    _silence(codes, v, rows)


@inline
def _silence(codes, v, rows):
    """Rows that say nothing (residual 0 at depth 1) for pixels without a ray."""
    for j in range(BLOCK):
        if codes[v, j] != OK:
            for i in range(11):
                rows[v, i, j] = 0.0
            rows[v, 11, j] = 1.0


@inline
def _pinhole_rows(cameras, v, pixels, codes, rows):
    """Without distortion the rows are those of the projection matrix P: P0 - u P2, P1 - v P2, P2."""
    for i in range(4):
        p0 = cameras[v, PROJECTION + i]
        p1 = cameras[v, PROJECTION + 4 + i]
        p2 = cameras[v, ROTATION + 6 + i] if i < 3 else cameras[v, TRANSLATION + 2]
        for j in range(BLOCK):
            rows[v, i, j] = p0 - pixels[v, 0, j] * p2
            rows[v, 4 + i, j] = p1 - pixels[v, 1, j] * p2
            rows[v, 8 + i, j] = p2
    missing = 0
    for j in range(BLOCK):
        code = OK if math.isfinite(pixels[v, 0, j] + pixels[v, 1, j]) else MISSING
        codes[v, j] = code
        missing += code
    if missing > 0:
        _silence(codes, v, rows)


@inline
def _fisheye_rows(cameras, v, pixels, codes, rows):
    """Rows of a fisheye: the derivative at the observed angle, the depth along the observed ray."""
    for j in range(BLOCK):
        y_d = (pixels[v, 1, j] - cameras[v, CY]) / cameras[v, FY]
        x_d = (pixels[v, 0, j] - cameras[v, CX] - cameras[v, SKEW] * y_d) / cameras[v, FX]
        radius = math.sqrt(x_d * x_d + y_d * y_d)
        theta = _fisheye_angle(cameras, v, radius)
        codes[v, j] = _angle_code(radius, theta)
        _, slope = _fisheye_radius(cameras, v, theta)
        sin = math.sin(theta)
        cos = math.cos(theta)
        toward_x = 1.0
        toward_y = 0.0
        across = 1.0
        if radius > 0.0:
            toward_x = x_d / radius
            toward_y = y_d / radius
            across = radius / sin
        # In the frame (outward, sideways, axis) the derivative is (slope cos, 0, -slope sin) and (0, across, 0).
        outward = slope * cos
        xx = toward_x * toward_x * outward + toward_y * toward_y * across
        xy = toward_x * toward_y * (outward - across)
        yy = toward_y * toward_y * outward + toward_x * toward_x * across
        xz = -slope * sin * toward_x
        yz = -slope * sin * toward_y
        _write_rows(cameras, v, xx, xy, xz, xy, yy, yz, sin * toward_x, sin * toward_y, cos, rows, j)
    _silence(codes, v, rows)


@inline
def _undistort_block(cameras, v, pixels, codes, scratch):
    """Newton on a whole block at once; the few pixels it does not settle get the careful scalar search.

    A settled lane stands still while others go on, so that a pixel's result does not depend on its neighbours.
    """
    for j in range(BLOCK):
        y_d = (pixels[v, 1, j] - cameras[v, CY]) / cameras[v, FY]
        x_d = (pixels[v, 0, j] - cameras[v, CX] - cameras[v, SKEW] * y_d) / cameras[v, FX]
        scratch[0, j] = x_d
        scratch[1, j] = y_d
        scratch[2, j] = math.inf
        scratch[4, j] = x_d
        scratch[5, j] = y_d
    for _ in range(_BLOCK_NEWTON):
        for j in range(BLOCK):
            x = scratch[0, j]
            y = scratch[1, j]
            last = scratch[2, j]
            f_x, f_y, a, b, c, d = distort(cameras, v, x, y)
            determinant = a * d - b * c
            inverse = 1.0 / determinant
            r_x = scratch[4, j] - f_x
            r_y = scratch[5, j] - f_y
            step_x = (d * r_x - b * r_y) * inverse
            step_y = (a * r_y - c * r_x) * inverse
            moving = last >= _SMALL_STEP_SQUARED
            scratch[0, j] = x + step_x if moving else x
            scratch[1, j] = y + step_y if moving else y
            scratch[2, j] = step_x * step_x + step_y * step_y if moving else last
            scratch[3, j] = determinant if moving else scratch[3, j]
        worst = 0.0
        for j in range(BLOCK):
            worst = max(worst, scratch[2, j])
        if worst < _SMALL_STEP_SQUARED:
            break
    limit = cameras[v, MAX_RADIUS] ** 2
    for j in range(BLOCK):
        x = scratch[0, j]
        y = scratch[1, j]
        x_d = scratch[4, j]
        y_d = scratch[5, j]
        if scratch[2, j] < _SMALL_STEP_SQUARED and scratch[3, j] > 0.0 and x * x + y * y <= limit:
            codes[v, j] = OK
            _, _, scratch[2, j], scratch[3, j], scratch[4, j], scratch[5, j] = distort(cameras, v, x, y)
        else:
            codes[v, j], scratch[0, j], scratch[1, j], scratch[2, j], scratch[3, j], scratch[4, j], scratch[5, j] = (
                undistort_normalised(cameras, v, x_d, y_d)
            )


@inline
def _write_rows(cameras, v, xx, xy, xz, yx, yy, yz, c_x, c_y, c_z, rows, j):
    """Rows from the derivative of the distorted point and the depth direction, both in camera coordinates."""
    fx = cameras[v, FX]
    fy = cameras[v, FY]
    skew = cameras[v, SKEW]
    ux = fx * xx + skew * yx
    uy = fx * xy + skew * yy
    uz = fx * xz + skew * yz
    vx = fy * yx
    vy = fy * yy
    vz = fy * yz
    for i in range(4):
        a = cameras[v, ROTATION + i] if i < 3 else cameras[v, TRANSLATION]
        b = cameras[v, ROTATION + 3 + i] if i < 3 else cameras[v, TRANSLATION + 1]
        d = cameras[v, ROTATION + 6 + i] if i < 3 else cameras[v, TRANSLATION + 2]
        rows[v, i, j] = ux * a + uy * b + uz * d
        rows[v, 4 + i, j] = vx * a + vy * b + vz * d
        rows[v, 8 + i, j] = c_x * a + c_y * b + c_z * d


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
