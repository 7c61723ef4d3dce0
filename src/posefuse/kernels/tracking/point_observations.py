"""Looks at the points of a body: their pixels, how those move with the points, and how well both are known."""

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
from posefuse.kernels.jit import inline, step


@step
def point_covariance(jacobian, starts, columns, node, m, cov, out):
    """The covariance of a node, xx xy xz yy yz zz, from that of the first ``m`` numbers of pose and shape.

    A node's columns ascend; past ``m`` are those of a shape that is kept, of which nothing is unknown.
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
def look_at_point(cameras, v, points, k):
    """The pixel of a point and how it moves with the point: status, pixel, and two rows of three numbers per metre."""
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
def spread_px(look, cov):
    """The covariance of a pixel whose point has the packed covariance ``cov``: uu, uv, vv."""
    a0 = cov[0] * look[3] + cov[1] * look[4] + cov[2] * look[5]
    a1 = cov[1] * look[3] + cov[3] * look[4] + cov[4] * look[5]
    a2 = cov[2] * look[3] + cov[4] * look[4] + cov[5] * look[5]
    b0 = cov[0] * look[6] + cov[1] * look[7] + cov[2] * look[8]
    b1 = cov[1] * look[6] + cov[3] * look[7] + cov[4] * look[8]
    b2 = cov[2] * look[6] + cov[4] * look[7] + cov[5] * look[8]
    uu = look[3] * a0 + look[4] * a1 + look[5] * a2
    uv = look[6] * a0 + look[7] * a1 + look[8] * a2
    vv = look[6] * b0 + look[7] * b1 + look[8] * b2
    return uu, uv, vv


@inline
def px_per_m_squared(look):
    """How large a metre is seen, squared, on average over directions across the view."""
    total = look[3] ** 2 + look[4] ** 2 + look[5] ** 2 + look[6] ** 2 + look[7] ** 2 + look[8] ** 2
    return 0.5 * total
