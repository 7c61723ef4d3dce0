"""Symmetric 3x3 systems, stored as six numbers (xx, xy, xz, yy, yz, zz): solution and inverse."""

from posefuse.kernels.jit import inline

# Smallest admissible pivot relative to the diagonal before elimination; rays within about 1e-7 rad count as parallel.
_SINGULAR_PIVOT = 1e-14


@inline
def solve_symmetric(xx, xy, xz, yy, yz, zz, bx, by, bz):
    """Solve a symmetric positive definite 3x3 system.

    Returns:
        ``(ok, x, y, z)``; not ok if a pivot vanishes relative to its diagonal, in which case the numbers are undefined.
    """
    w0 = 1.0 / xx
    l1 = xy * w0
    l2 = xz * w0
    d1 = yy - l1 * xy
    w1 = 1.0 / d1
    e = yz - l1 * xz
    l3 = e * w1
    d2 = zz - l2 * xz - l3 * e
    y1 = by - l1 * bx
    z = (bz - l2 * bx - l3 * y1) / d2
    y = y1 * w1 - l3 * z
    x = bx * w0 - l1 * y - l2 * z
    return (xx > 0.0) & (d1 > _SINGULAR_PIVOT * yy) & (d2 > _SINGULAR_PIVOT * zz), x, y, z


@inline
def invert_symmetric(xx, xy, xz, yy, yz, zz):
    """Invert a symmetric positive definite 3x3 matrix; return ``(ok, xx, xy, xz, yy, yz, zz)``."""
    w0 = 1.0 / xx
    l1 = xy * w0
    l2 = xz * w0
    d1 = yy - l1 * xy
    w1 = 1.0 / d1
    e = yz - l1 * xz
    l3 = e * w1
    d2 = zz - l2 * xz - l3 * e
    w2 = 1.0 / d2
    # With A = L D L^T the inverse is M^T D^-1 M, M = L^-1 = [[1, 0, 0], [-l1, 1, 0], [m, -l3, 1]].
    m = l1 * l3 - l2
    return (
        (xx > 0.0) & (d1 > _SINGULAR_PIVOT * yy) & (d2 > _SINGULAR_PIVOT * zz),
        w0 + l1 * l1 * w1 + m * m * w2,
        -l1 * w1 - m * l3 * w2,
        m * w2,
        w1 + l3 * l3 * w2,
        -l3 * w2,
        w2,
    )
