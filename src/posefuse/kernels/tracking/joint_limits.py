"""Limits of joints in normal equations: one-sided, of no effect where a joint stands within them.

Of bodies as :mod:`posefuse.kernels.tracking.articulated` has them; kinds and axes are of ``Tree.packed_limits``.
"""

from posefuse.kernels.jit import step

HINGE = 0
TWIST = 2


@step
def add_twist(body, limit, stiffness, turns, hessian, gradient):
    """The same of two segments whose common axis has turned too far from the one to the other."""
    first, second = body.limits[limit, 1], body.limits[limit, 3]
    one, other = turns[first], turns[second]
    a0, a1, a2 = body.limit_axes[limit, 0], body.limit_axes[limit, 1], body.limit_axes[limit, 2]
    x = one[0, 0] * a0 + one[0, 1] * a1 + one[0, 2] * a2
    y = one[1, 0] * a0 + one[1, 1] * a1 + one[1, 2] * a2
    z = one[2, 0] * a0 + one[2, 1] * a1 + one[2, 2] * a2
    u = other[0, 0] * a0 + other[0, 1] * a1 + other[0, 2] * a2
    v = other[1, 0] * a0 + other[1, 1] * a1 + other[1, 2] * a2
    w = other[2, 0] * a0 + other[2, 1] * a1 + other[2, 2] * a2
    short = body.limit_axes[limit, 3] - (x * u + y * v + z * w)
    if short <= 0.0:
        return 0.0
    for i in range(3):
        # The common axis turns with its segment: (turn x axis) . other = turn . (axis x other), in world axes.
        d = one[0, i] * (y * w - z * v) + one[1, i] * (z * u - x * w) + one[2, i] * (x * v - y * u)
        gradient[3 + 3 * first + i] += stiffness * short * d
        e = -(other[0, i] * (y * w - z * v) + other[1, i] * (z * u - x * w) + other[2, i] * (x * v - y * u))
        gradient[3 + 3 * second + i] += stiffness * short * e
        for j in range(3):
            dj = one[0, j] * (y * w - z * v) + one[1, j] * (z * u - x * w) + one[2, j] * (x * v - y * u)
            ej = -(other[0, j] * (y * w - z * v) + other[1, j] * (z * u - x * w) + other[2, j] * (x * v - y * u))
            if j <= i:
                hessian[3 + 3 * first + i, 3 + 3 * first + j] += stiffness * d * dj
                hessian[3 + 3 * second + i, 3 + 3 * second + j] += stiffness * e * ej
            if first > second:
                hessian[3 + 3 * first + i, 3 + 3 * second + j] += stiffness * d * ej
            else:
                hessian[3 + 3 * second + i, 3 + 3 * first + j] += stiffness * e * dj
    return 0.5 * stiffness * short * short


@step
def add_limit(body, limit, stiffness, turns, bones, hessian, gradient):
    """A joint limit that is overstepped pulls back; what that costs."""
    kind, bone, before, segment = (
        body.limits[limit, 0],
        body.limits[limit, 1],
        body.limits[limit, 2],
        body.limits[limit, 3],
    )
    axes = turns[segment]
    a0 = body.limit_axes[limit, 0]
    a1 = body.limit_axes[limit, 1]
    a2 = body.limit_axes[limit, 2]
    x = axes[0, 0] * a0 + axes[0, 1] * a1 + axes[0, 2] * a2
    y = axes[1, 0] * a0 + axes[1, 1] * a1 + axes[1, 2] * a2
    z = axes[2, 0] * a0 + axes[2, 1] * a1 + axes[2, 2] * a2
    first = 3 + 3 * turns.shape[0]
    far = bones[bone]
    if kind == HINGE:
        near = bones[before]
        # The gradient by the far bone's direction is axis x near, by the near one's far x axis.
        gx = y * near[2, 2] - z * near[1, 2]
        gy = z * near[0, 2] - x * near[2, 2]
        gz = x * near[1, 2] - y * near[0, 2]
        hx = far[1, 2] * z - far[2, 2] * y
        hy = far[2, 2] * x - far[0, 2] * z
        hz = far[0, 2] * y - far[1, 2] * x
    else:
        gx, gy, gz = x, y, z
        hx = hy = hz = 0.0
    value = gx * far[0, 2] + gy * far[1, 2] + gz * far[2, 2]
    short = body.limit_axes[limit, 3] - value
    if short <= 0.0:
        return 0.0
    i = first + 2 * bone
    d0 = -(gx * far[0, 1] + gy * far[1, 1] + gz * far[2, 1])
    d1 = gx * far[0, 0] + gy * far[1, 0] + gz * far[2, 0]
    gradient[i] += stiffness * short * d0
    gradient[i + 1] += stiffness * short * d1
    hessian[i, i] += stiffness * d0 * d0
    hessian[i + 1, i] += stiffness * d0 * d1
    hessian[i + 1, i + 1] += stiffness * d1 * d1
    if kind == HINGE:
        near = bones[before]
        j = first + 2 * before
        e0 = -(hx * near[0, 1] + hy * near[1, 1] + hz * near[2, 1])
        e1 = hx * near[0, 0] + hy * near[1, 0] + hz * near[2, 0]
        gradient[j] += stiffness * short * e0
        gradient[j + 1] += stiffness * short * e1
        hessian[j, j] += stiffness * e0 * e0
        hessian[j + 1, j] += stiffness * e0 * e1
        hessian[j + 1, j + 1] += stiffness * e1 * e1
        high, low = max(i, j), min(i, j)
        for s in range(2):
            for t in range(2):
                left = (d0 if s == 0 else d1) if high == i else (e0 if s == 0 else e1)
                right = (e0 if t == 0 else e1) if high == i else (d0 if t == 0 else d1)
                hessian[high + s, low + t] += stiffness * left * right
    return 0.5 * stiffness * short * short
