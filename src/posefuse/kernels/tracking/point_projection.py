"""Projection of body nodes: their pixels, the derivatives of the pixels, and the covariances of both."""

from posefuse.kernels.cameras.lens import (
    CX,
    CY,
    FX,
    FY,
    LENS,
    OK,
    PINHOLE,
    ROTATION,
    SKEW,
    project_jacobian,
    project_point,
    to_camera,
)
from posefuse.kernels.jit import inline, subroutine


@subroutine
def point_covariance(jacobian, starts, columns, node, m, cov, out):
    """Write the covariance of a node, xx xy xz yy yz zz, from that of the first ``m`` numbers of pose and shape.

    The columns of a node ascend; those from ``m`` on belong to a fixed shape, which has no variance.
    """
    for e in range(6):
        out[e] = 0.0
    last = starts[node + 1]
    while last > starts[node] and columns[last - 1] >= m:
        last -= 1
    for a in range(starts[node], last):
        i = columns[a]
        x = y = z = 0.0
        for b in range(starts[node], last):
            j = columns[b]
            x += cov[i, j] * jacobian[node, 0, j]
            y += cov[i, j] * jacobian[node, 1, j]
            z += cov[i, j] * jacobian[node, 2, j]
        out[0] += jacobian[node, 0, i] * x
        out[1] += jacobian[node, 0, i] * y
        out[2] += jacobian[node, 0, i] * z
        out[3] += jacobian[node, 1, i] * y
        out[4] += jacobian[node, 1, i] * z
        out[5] += jacobian[node, 2, i] * z


@inline
def project_node(cameras, v, points, k):
    """Return the status and pixel of a point, and the derivative of the pixel: two rows of three numbers, px per m."""
    x, y, z = to_camera(cameras, v, points[k, 0], points[k, 1], points[k, 2])
    if cameras[v, LENS] == PINHOLE and z > 0.0:
        inverse = 1.0 / z
        status = OK
        ux, uy = cameras[v, FX] * inverse, cameras[v, SKEW] * inverse
        vx, vy = 0.0, cameras[v, FY] * inverse
        uz = -(ux * x + uy * y) * inverse
        vz = -vy * y * inverse
        pixel_u, pixel_v = cameras[v, CX] + ux * x + uy * y, cameras[v, CY] + vy * y
    else:
        status, pixel_u, pixel_v = project_point(cameras, v, x, y, z)
        _, ux, uy, uz, vx, vy, vz = project_jacobian(cameras, v, x, y, z)
    r = ROTATION
    r0, r1, r2 = cameras[v, r], cameras[v, r + 1], cameras[v, r + 2]
    r3, r4, r5 = cameras[v, r + 3], cameras[v, r + 4], cameras[v, r + 5]
    r6, r7, r8 = cameras[v, r + 6], cameras[v, r + 7], cameras[v, r + 8]
    return (
        status,
        pixel_u,
        pixel_v,
        ux * r0 + uy * r3 + uz * r6,
        ux * r1 + uy * r4 + uz * r7,
        ux * r2 + uy * r5 + uz * r8,
        vx * r0 + vy * r3 + vz * r6,
        vx * r1 + vy * r4 + vz * r7,
        vx * r2 + vy * r5 + vz * r8,
    )


@inline
def pixel_covariance(view, cov):
    """Return the covariance (uu, uv, vv) of the pixel of a point with packed covariance ``cov``."""
    a0 = cov[0] * view[3] + cov[1] * view[4] + cov[2] * view[5]
    a1 = cov[1] * view[3] + cov[3] * view[4] + cov[4] * view[5]
    a2 = cov[2] * view[3] + cov[4] * view[4] + cov[5] * view[5]
    b0 = cov[0] * view[6] + cov[1] * view[7] + cov[2] * view[8]
    b1 = cov[1] * view[6] + cov[3] * view[7] + cov[4] * view[8]
    b2 = cov[2] * view[6] + cov[4] * view[7] + cov[5] * view[8]
    uu = view[3] * a0 + view[4] * a1 + view[5] * a2
    uv = view[6] * a0 + view[7] * a1 + view[8] * a2
    vv = view[6] * b0 + view[7] * b1 + view[8] * b2
    return uu, uv, vv


@inline
def squared_px_per_m(view):
    """Return the squared length of a meter in px, averaged over directions across the line of sight."""
    total = view[3] ** 2 + view[4] ** 2 + view[5] ** 2 + view[6] ** 2 + view[7] ** 2 + view[8] ** 2
    return 0.5 * total
