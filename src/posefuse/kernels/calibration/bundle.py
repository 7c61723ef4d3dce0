"""Bundle adjustment terms of each observation: its residual, and the derivatives by point and by lens."""

import math

from posefuse.kernels.cameras import lens
from posefuse.kernels.cameras.lens import project_jacobian, project_point, to_camera
from posefuse.kernels.jit import kernel, subroutine

LENS_PARAMETERS = 12
"""Number of lens parameters: fx, fy, cx, cy, then the distortion coefficients in the order of the camera array."""
DISTORTION = 4
"""First distortion coefficient among the lens parameters."""


@subroutine
def _lens_rows(cameras, v, x, y, z, rows, n):
    """Write the derivatives of the pixel with respect to the lens parameters."""
    fx = cameras[v, lens.FX]
    fy = cameras[v, lens.FY]
    skew = cameras[v, lens.SKEW]
    _, u_px, v_px = project_point(cameras, v, x, y, z)
    y_d = (v_px - cameras[v, lens.CY]) / fy
    for k in range(LENS_PARAMETERS):
        rows[n, 0, k] = 0.0
        rows[n, 1, k] = 0.0
    rows[n, 0, 0] = (u_px - cameras[v, lens.CX] - skew * y_d) / fx
    rows[n, 1, 1] = y_d
    rows[n, 0, 2] = 1.0
    rows[n, 1, 3] = 1.0
    if cameras[v, lens.LENS] == lens.FISHEYE:
        rho = math.sqrt(x * x + y * y)
        theta = math.atan2(rho, z)
        power = theta**3 / rho if rho > 0.0 else 0.0
        for k in range(4):
            rows[n, 0, DISTORTION + k] = (fx * x + skew * y) * power
            rows[n, 1, DISTORTION + k] = fy * y * power
            power *= theta * theta
    elif cameras[v, lens.LENS] != lens.PINHOLE:
        _polynomial_rows(cameras, v, x / z, y / z, rows, n)


@subroutine
def _polynomial_rows(cameras, v, a, b, rows, n):
    """Write the derivatives by the coefficients of a Brown or rational lens at (a, b) in the plane z = 1."""
    fx = cameras[v, lens.FX]
    fy = cameras[v, lens.FY]
    skew = cameras[v, lens.SKEW]
    s = a * a + b * b
    denominator = 1.0
    radial = 1.0 + s * (cameras[v, lens.K1] + s * (cameras[v, lens.K2] + s * cameras[v, lens.K3]))
    if cameras[v, lens.LENS] == lens.RATIONAL:
        denominator = 1.0 + s * (cameras[v, lens.K4] + s * (cameras[v, lens.K5] + s * cameras[v, lens.K6]))
    along = (fx * a + skew * b) / denominator
    down = fy * b / denominator
    radial /= denominator
    power = s
    for k in range(3):
        column = DISTORTION + (k if k < 2 else 4)
        rows[n, 0, column] = along * power
        rows[n, 1, column] = down * power
        if cameras[v, lens.LENS] == lens.RATIONAL:
            rows[n, 0, DISTORTION + 5 + k] = -along * radial * power
            rows[n, 1, DISTORTION + 5 + k] = -down * radial * power
        power *= s
    p1 = DISTORTION + 2
    rows[n, 0, p1] = fx * 2.0 * a * b + skew * (s + 2.0 * b * b)
    rows[n, 1, p1] = fy * (s + 2.0 * b * b)
    rows[n, 0, p1 + 1] = fx * (s + 2.0 * a * a) + skew * 2.0 * a * b
    rows[n, 1, p1 + 1] = fy * 2.0 * a * b


@kernel
def bundle_rows(cameras, view, points, pixels, residuals, by_point, by_lens, status):
    """Compute residuals of observations and their derivatives.

    Args:
        cameras: shape (view, COLUMNS).
        view: shape (observation,), int64.
        points: shape (observation, 3), in the world, one per observation.
        pixels: shape (observation, 2).
        residuals: shape (observation, 2), written: projected minus observed.
        by_point: shape (observation, 2, 3), written: derivatives by the point in camera coordinates.
        by_lens: shape (observation, 2, LENS_PARAMETERS), written.
        status: shape (observation,), written: lens codes; the other outputs are NaN where it is not OK.
    """
    for n in range(view.shape[0]):
        v = view[n]
        x, y, z = to_camera(cameras, v, points[n, 0], points[n, 1], points[n, 2])
        code, pixel_u, pixel_v = project_point(cameras, v, x, y, z)
        status[n] = code
        residuals[n, 0] = pixel_u - pixels[n, 0]
        residuals[n, 1] = pixel_v - pixels[n, 1]
        if code != lens.OK:
            by_point[n] = math.nan
            by_lens[n] = math.nan
            continue
        (
            _,
            by_point[n, 0, 0],
            by_point[n, 0, 1],
            by_point[n, 0, 2],
            by_point[n, 1, 0],
            by_point[n, 1, 1],
            by_point[n, 1, 2],
        ) = project_jacobian(cameras, v, x, y, z)
        _lens_rows(cameras, v, x, y, z, by_lens, n)
