"""Observation rows: each pixel as three rows that make its reprojection residual linear, a block of pixels at a time.

What all triangulation works on; see docs/methods.md, "Observation rows".
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
    undistort_normalised,
)
from posefuse.kernels.jit import choice, inline

BLOCK = 16
"""Points are worked through in blocks of this many, so that the compiler can use vector instructions.

With more, the rows of a dozen views outgrow the nearest cache, and more points wait for the slowest of their block;
with fewer, loops over a block are unrolled before they become vector instructions, and never do.
"""

_BLOCK_NEWTON = 8


@choice
def rows_block(cameras, distorted, fisheye, v, pixels, codes, rows, scratch):
    """Turn a block of pixels of one view into the rows that make reprojection linear: what all triangulation works on.

    With ``g0, g1, c`` the rows (each of 4, acting on the homogeneous world point), the reprojection residual in true
    pixels is ``(g0.X / c.X, g1.X / c.X)``: exact without distortion, and to first order in the residual with it, the
    lens having been linearised once, at the observed pixel. ``c.X`` is the depth (for the fisheye: along the observed
    ray), positive in front of the camera. See docs/methods.md, "Observation rows".

    Args:
        cameras: the camera array.
        distorted: None if the rig has no lens with distortion polynomials, which then are not compiled either.
        fisheye: None if it has no fisheye.
        v: the view.
        pixels: shape (view, 2, BLOCK).
        codes: shape (view, BLOCK), written: the status of each pixel.
        rows: shape (view, 12, BLOCK), written: g0, g1, c; where the status is not OK, rows that say nothing.
        scratch: shape (6, BLOCK).
    """
    if fisheye is not None and cameras[v, LENS] == FISHEYE:
        _fisheye_rows(cameras, v, pixels, codes, rows)
        return
    if distorted is not None and cameras[v, LENS] != PINHOLE:
        _distorted_rows(cameras, v, pixels, codes, rows, scratch)
        return
    _pinhole_rows(cameras, v, pixels, codes, rows)


@inline
def _distorted_rows(cameras, v, pixels, codes, rows, scratch):
    """Rows of a lens with distortion polynomials: the derivative at the undistorted pixel."""
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
        theta = fisheye_angle(cameras, v, radius)
        codes[v, j] = angle_code(radius, theta)
        _, slope = fisheye_radius(cameras, v, theta)
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
            moving = last >= SMALL_STEP_SQUARED
            scratch[0, j] = x + step_x if moving else x
            scratch[1, j] = y + step_y if moving else y
            scratch[2, j] = step_x * step_x + step_y * step_y if moving else last
            scratch[3, j] = determinant if moving else scratch[3, j]
        worst = 0.0
        for j in range(BLOCK):
            worst = max(worst, scratch[2, j])
        if worst < SMALL_STEP_SQUARED:
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


@inline
def residual(rows, v, j, x, y, z):
    """What view ``v`` of lane ``j`` says of a point: ``(depth, r, s)``, the residual in px (behind: meaningless)."""
    depth = rows[v, 8, j] * x + rows[v, 9, j] * y + rows[v, 10, j] * z + rows[v, 11, j]
    inverse = 1.0 / depth
    r = (rows[v, 0, j] * x + rows[v, 1, j] * y + rows[v, 2, j] * z + rows[v, 3, j]) * inverse
    s = (rows[v, 4, j] * x + rows[v, 5, j] * y + rows[v, 6, j] * z + rows[v, 7, j]) * inverse
    return depth, r, s
