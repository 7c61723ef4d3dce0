"""Bundle adjustment terms of each observation: its residual, and the derivatives by point and by lens."""

import math

from posefuse.kernels.cameras import lens
from posefuse.kernels.cameras.lens import project_jacobian, project_point, to_camera
from posefuse.kernels.jit import kernel, subroutine

LENS_PARAMETERS = 3
"""Number of lens parameters: logarithm of the focal length, then the first two radial distortion coefficients."""


@subroutine
def _lens_rows(cameras, v, x, y, z, rows, n):
    """Write the derivative of the pixel with respect to the logarithm of the focal length, k1 and k2."""
    fx = cameras[v, lens.FX]
    fy = cameras[v, lens.FY]
    skew = cameras[v, lens.SKEW]
    _, u_px, v_px = project_point(cameras, v, x, y, z)
    rows[n, 0, 0] = u_px - cameras[v, lens.CX]
    rows[n, 1, 0] = v_px - cameras[v, lens.CY]
    if cameras[v, lens.LENS] == lens.FISHEYE:
        rho = math.sqrt(x * x + y * y)
        theta = math.atan2(rho, z)
        first = theta**3 / rho if rho > 0.0 else 0.0
        second = first * theta * theta
        a, b = x, y
    else:
        a = x / z
        b = y / z
        s = a * a + b * b
        first = s
        second = s * s
        if cameras[v, lens.LENS] == lens.RATIONAL:
            denominator = 1.0 + s * (cameras[v, lens.K4] + s * (cameras[v, lens.K5] + s * cameras[v, lens.K6]))
            first /= denominator
            second /= denominator
    rows[n, 0, 1] = (fx * a + skew * b) * first
    rows[n, 1, 1] = fy * b * first
    rows[n, 0, 2] = (fx * a + skew * b) * second
    rows[n, 1, 2] = fy * b * second


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
