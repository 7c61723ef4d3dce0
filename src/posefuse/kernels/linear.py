"""Reprojection made linear at given points: residuals and their derivatives, through the whole lens model."""

import math

from posefuse.kernels.jit import kernel
from posefuse.kernels.lens import OK, ROTATION, project_jacobian, project_point, to_camera


@kernel
def linearise(cameras, points, pixels, residuals, jacobians):
    """Residuals of observations at points, and how they change with the points.

    Args:
        cameras: the camera array, shape (view, COLUMNS).
        points: shape (point, 3), in the world.
        pixels: shape (point, view, 2), NaN where missing.
        residuals: shape (point, view, 2), written: projected less observed, px; NaN where there is none.
        jacobians: shape (point, view, 2, 3), written: derivatives of the residuals, px per unit; NaN where there is
            none.
    """
    for n in range(points.shape[0]):
        for v in range(cameras.shape[0]):
            x, y, z = to_camera(cameras, v, points[n, 0], points[n, 1], points[n, 2])
            status, pixel_u, pixel_v = project_point(cameras, v, x, y, z)
            _, u_x, u_y, u_z, v_x, v_y, v_z = project_jacobian(cameras, v, x, y, z)
            there = status == OK and math.isfinite(pixels[n, v, 0] + pixels[n, v, 1])
            residuals[n, v, 0] = pixel_u - pixels[n, v, 0] if there else math.nan
            residuals[n, v, 1] = pixel_v - pixels[n, v, 1] if there else math.nan
            for i in range(3):
                r_x = cameras[v, ROTATION + i]
                r_y = cameras[v, ROTATION + 3 + i]
                r_z = cameras[v, ROTATION + 6 + i]
                jacobians[n, v, 0, i] = u_x * r_x + u_y * r_y + u_z * r_z if there else math.nan
                jacobians[n, v, 1, i] = v_x * r_x + v_y * r_y + v_z * r_z if there else math.nan
