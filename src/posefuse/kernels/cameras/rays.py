"""Viewing rays: the point closest to several rays, and the distance of a point from a ray.

The least-squares intersection minimizes ``sum_i w_i || (I - d_i d_i^T) (X - s_i) ||^2``, the squared distances from the
rays (Slabaugh, Schafer & Livingston 2001, "Optimal Ray Intersection For Computing 3D Points From N-View
Correspondences"). With ``w_i = 1 / (sigma depth_i / f_i)^2`` it approximates the maximum-likelihood point.
"""

import math

from posefuse.kernels.cameras.points import OK, SINGULAR
from posefuse.kernels.jit import inline, kernel
from posefuse.kernels.linear_algebra.symmetric_3x3 import invert_symmetric, solve_symmetric


@inline
def point_ray_distance(px, py, pz, sx, sy, sz, dx, dy, dz):
    """Return the distance of a point from the line through ``s`` along unit vector ``d``, and its position along it."""
    x = px - sx
    y = py - sy
    z = pz - sz
    along = x * dx + y * dy + z * dz
    ax = x - along * dx
    ay = y - along * dy
    az = z - along * dz
    return math.sqrt(ax * ax + ay * ay + az * az), along


@kernel
def intersect_rays(origins, directions, weights, points, covariance, status):
    """Compute the weighted least-squares intersection of the rays of each row.

    Args:
        origins: shape (view, 3): ray origins.
        directions: shape (point, view, 3): unit vectors in the world; NaN where there is no ray.
        weights: shape (point, view); 0 ignores a ray.
        points: shape (point, 3), written; NaN if the rays do not determine a point.
        covariance: shape (point, 6), written: inverse of the weighted normal matrix, xx xy xz yy yz zz.
        status: shape (point,), int64, written: OK or SINGULAR of :mod:`posefuse.kernels.cameras.points`.
    """
    for n in range(directions.shape[0]):
        xx = xy = xz = yy = yz = zz = 0.0
        bx = by = bz = 0.0
        for v in range(directions.shape[1]):
            dx = directions[n, v, 0]
            dy = directions[n, v, 1]
            dz = directions[n, v, 2]
            w = weights[n, v]
            if not (w > 0.0 and math.isfinite(dx + dy + dz)):
                continue
            along = dx * origins[v, 0] + dy * origins[v, 1] + dz * origins[v, 2]
            xx += w * (1.0 - dx * dx)
            xy -= w * dx * dy
            xz -= w * dx * dz
            yy += w * (1.0 - dy * dy)
            yz -= w * dy * dz
            zz += w * (1.0 - dz * dz)
            bx += w * (origins[v, 0] - along * dx)
            by += w * (origins[v, 1] - along * dy)
            bz += w * (origins[v, 2] - along * dz)
        solved, x, y, z = solve_symmetric(xx, xy, xz, yy, yz, zz, bx, by, bz)
        status[n] = OK if solved else SINGULAR
        points[n, 0] = x if solved else math.nan
        points[n, 1] = y if solved else math.nan
        points[n, 2] = z if solved else math.nan
        _, cxx, cxy, cxz, cyy, cyz, czz = invert_symmetric(xx, xy, xz, yy, yz, zz)
        covariance[n, 0] = cxx if solved else math.nan
        covariance[n, 1] = cxy if solved else math.nan
        covariance[n, 2] = cxz if solved else math.nan
        covariance[n, 3] = cyy if solved else math.nan
        covariance[n, 4] = cyz if solved else math.nan
        covariance[n, 5] = czz if solved else math.nan
