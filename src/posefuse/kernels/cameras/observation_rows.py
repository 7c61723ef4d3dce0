"""Observation rows: each pixel as three rows that make its reprojection residual linear, one block of pixels at a time.

All triangulation methods use them; see docs/methods/cameras.md.
"""

import math

from posefuse.kernels.cameras.lens import (
    CX,
    CY,
    FISHEYE,
    FX,
    FY,
    LENS,
    MAX_RADIUS,
    MISSING,
    OK,
    PINHOLE,
    PROJECTION,
    ROTATION,
    SKEW,
    SMALL_STEP_SQUARED,
    TRANSLATION,
    angle_code,
    distort,
    fisheye_angle,
    fisheye_radius,
    undistort_normalized,
)
from posefuse.kernels.jit import inline, subroutine

BLOCK = 16
"""Number of points per block, so that the compiler can use vector instructions.

With larger blocks, the rows of a dozen views outgrow the L1 cache, and more points wait for the slowest one of their
block. With smaller blocks, the compiler unrolls the loops over a block before it vectorizes them.
"""

_BLOCK_NEWTON_ITERATIONS = 8


@inline
def rows_block(cameras, v, pixels, codes, rows, scratch):
    """Convert a block of pixels of one view to rows that make the reprojection residual linear.

    With the rows ``g0, g1, c`` (4 numbers each, acting on the homogeneous world point), the reprojection residual in
    true pixels is ``(g0.X / c.X, g1.X / c.X)``. It is exact without distortion. With distortion it is accurate to first
    order in the residual, because the lens is linearized once, at the observed pixel. ``c.X`` is the depth (for the
    fisheye: along the observed ray) and is positive in front of the camera. See docs/methods/cameras.md.

    Args:
        cameras: the camera array.
        v: the view.
        pixels: shape (view, 2, BLOCK).
        codes: shape (view, BLOCK), written: lens status of each pixel.
        rows: shape (view, 12, BLOCK), written: g0, g1, c; zero residual at depth 1 where the status is not OK.
        scratch: shape (6, BLOCK).
    """
    if cameras[v, LENS] == FISHEYE:
        _fisheye_rows(cameras, v, pixels, codes, rows)
        return
    if cameras[v, LENS] != PINHOLE:
        _distorted_rows(cameras, v, pixels, codes, rows, scratch)
        return
    _pinhole_rows(cameras, v, pixels, codes, rows)


@subroutine
def _distorted_rows(cameras, v, pixels, codes, rows, scratch):
    """Write the rows of a lens with distortion polynomials: the derivative at the undistorted pixel."""
    _undistort_block(cameras, v, pixels, codes, scratch)
    for j in range(BLOCK):
        x = scratch[0, j]
        y = scratch[1, j]
        a = scratch[2, j]
        b = scratch[3, j]
        c = scratch[4, j]
        d = scratch[5, j]
        _write_rows(cameras, v, a, b, -(a * x + b * y), c, d, -(c * x + d * y), 0.0, 0.0, 1.0, rows, j)
    _clear_invalid_rows(codes, v, rows)


@inline
def _clear_invalid_rows(codes, v, rows):
    """Write rows with residual 0 at depth 1 for pixels without a ray."""
    for j in range(BLOCK):
        if codes[v, j] != OK:
            for i in range(11):
                rows[v, i, j] = 0.0
            rows[v, 11, j] = 1.0


@inline
def _pinhole_rows(cameras, v, pixels, codes, rows):
    """Write the rows of a pinhole camera with projection matrix P: P0 - u P2, P1 - v P2, P2."""
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
        _clear_invalid_rows(codes, v, rows)


@subroutine
def _fisheye_rows(cameras, v, pixels, codes, rows):
    """Write the rows of a fisheye: the derivative at the observed angle, the depth along the observed ray."""
    for j in range(BLOCK):
        y_d = (pixels[v, 1, j] - cameras[v, CY]) / cameras[v, FY]
        x_d = (pixels[v, 0, j] - cameras[v, CX] - cameras[v, SKEW] * y_d) / cameras[v, FX]
        radius = math.sqrt(x_d * x_d + y_d * y_d)
        theta = fisheye_angle(cameras, v, radius)
        codes[v, j] = angle_code(radius, theta)
        _, slope = fisheye_radius(cameras, v, theta)
        sin = math.sin(theta)
        cos = math.cos(theta)
        radial_x = 1.0
        radial_y = 0.0
        tangential = 1.0
        if radius > 0.0:
            radial_x = x_d / radius
            radial_y = y_d / radius
            tangential = radius / sin
        # In (radial, tangential, axial) axes the derivative is (slope cos, 0, -slope sin) and (0, tangential, 0).
        radial = slope * cos
        xx = radial_x * radial_x * radial + radial_y * radial_y * tangential
        xy = radial_x * radial_y * (radial - tangential)
        yy = radial_y * radial_y * radial + radial_x * radial_x * tangential
        xz = -slope * sin * radial_x
        yz = -slope * sin * radial_y
        _write_rows(cameras, v, xx, xy, xz, xy, yy, yz, sin * radial_x, sin * radial_y, cos, rows, j)
    _clear_invalid_rows(codes, v, rows)


@inline
def _undistort_block(cameras, v, pixels, codes, scratch):
    """Undistort a whole block by Newton's method; pixels that do not converge use the slower scalar search.

    A converged lane stays fixed while others continue, so the result of a pixel does not depend on its neighbors.
    """
    for j in range(BLOCK):
        y_d = (pixels[v, 1, j] - cameras[v, CY]) / cameras[v, FY]
        x_d = (pixels[v, 0, j] - cameras[v, CX] - cameras[v, SKEW] * y_d) / cameras[v, FX]
        scratch[0, j] = x_d
        scratch[1, j] = y_d
        scratch[2, j] = math.inf
        scratch[4, j] = x_d
        scratch[5, j] = y_d
    for _ in range(_BLOCK_NEWTON_ITERATIONS):
        for j in range(BLOCK):
            x = scratch[0, j]
            y = scratch[1, j]
            previous_step_squared = scratch[2, j]
            f_x, f_y, a, b, c, d = distort(cameras, v, x, y)
            determinant = a * d - b * c
            inverse = 1.0 / determinant
            r_x = scratch[4, j] - f_x
            r_y = scratch[5, j] - f_y
            step_x = (d * r_x - b * r_y) * inverse
            step_y = (a * r_y - c * r_x) * inverse
            active = previous_step_squared >= SMALL_STEP_SQUARED
            scratch[0, j] = x + step_x if active else x
            scratch[1, j] = y + step_y if active else y
            scratch[2, j] = step_x * step_x + step_y * step_y if active else previous_step_squared
            scratch[3, j] = determinant if active else scratch[3, j]
        largest_step_squared = 0.0
        for j in range(BLOCK):
            largest_step_squared = max(largest_step_squared, scratch[2, j])
        if largest_step_squared < SMALL_STEP_SQUARED:
            break
    limit = cameras[v, MAX_RADIUS] ** 2
    for j in range(BLOCK):
        x = scratch[0, j]
        y = scratch[1, j]
        x_d = scratch[4, j]
        y_d = scratch[5, j]
        if scratch[2, j] < SMALL_STEP_SQUARED and scratch[3, j] > 0.0 and x * x + y * y <= limit:
            codes[v, j] = OK
            _, _, scratch[2, j], scratch[3, j], scratch[4, j], scratch[5, j] = distort(cameras, v, x, y)
        else:
            codes[v, j], scratch[0, j], scratch[1, j], scratch[2, j], scratch[3, j], scratch[4, j], scratch[5, j] = (
                undistort_normalized(cameras, v, x_d, y_d)
            )


@inline
def _write_rows(cameras, v, xx, xy, xz, yx, yy, yz, c_x, c_y, c_z, rows, j):
    """Write rows from the derivative of the distorted point and the depth direction, both in camera coordinates."""
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


@inline
def residual(rows, v, j, x, y, z):
    """Return ``(depth, r, s)`` of a point in view ``v`` of lane ``j``; residual in px, undefined behind the camera."""
    depth = rows[v, 8, j] * x + rows[v, 9, j] * y + rows[v, 10, j] * z + rows[v, 11, j]
    inverse = 1.0 / depth
    r = (rows[v, 0, j] * x + rows[v, 1, j] * y + rows[v, 2, j] * z + rows[v, 3, j]) * inverse
    s = (rows[v, 4, j] * x + rows[v, 5, j] * y + rows[v, 6, j] * z + rows[v, 7, j]) * inverse
    return depth, r, s
