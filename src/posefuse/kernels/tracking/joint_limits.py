"""One-sided joint limits in the normal equations; a joint within its limits adds nothing.

Bodies are those of :mod:`posefuse.kernels.tracking.records`; kinds and axes come from ``Tree.packed_limits``.
"""

from posefuse.kernels.jit import subroutine

HINGE = 0
TWIST = 2


@subroutine
def add_twist(body, limit, stiffness, turns, hessian, gradient):
    """Add the twist limit between two segments, about their common axis, to the equations; return its cost."""
    first, second = body.limits[limit, 1], body.limits[limit, 3]
    first_axes, second_axes = turns[first], turns[second]
    a0, a1, a2 = body.limit_axes[limit, 0], body.limit_axes[limit, 1], body.limit_axes[limit, 2]
    x = first_axes[0, 0] * a0 + first_axes[0, 1] * a1 + first_axes[0, 2] * a2
    y = first_axes[1, 0] * a0 + first_axes[1, 1] * a1 + first_axes[1, 2] * a2
    z = first_axes[2, 0] * a0 + first_axes[2, 1] * a1 + first_axes[2, 2] * a2
    u = second_axes[0, 0] * a0 + second_axes[0, 1] * a1 + second_axes[0, 2] * a2
    v = second_axes[1, 0] * a0 + second_axes[1, 1] * a1 + second_axes[1, 2] * a2
    w = second_axes[2, 0] * a0 + second_axes[2, 1] * a1 + second_axes[2, 2] * a2
    violation = body.limit_axes[limit, 3] - (x * u + y * v + z * w)
    if violation <= 0.0:
        return 0.0
    for i in range(3):
        # The common axis rotates with its segment: (turn x axis) . other = turn . (axis x other), in world axes.
        d = first_axes[0, i] * (y * w - z * v) + first_axes[1, i] * (z * u - x * w) + first_axes[2, i] * (x * v - y * u)
        gradient[3 + 3 * first + i] += stiffness * violation * d
        e = -(
            second_axes[0, i] * (y * w - z * v)
            + second_axes[1, i] * (z * u - x * w)
            + second_axes[2, i] * (x * v - y * u)
        )
        gradient[3 + 3 * second + i] += stiffness * violation * e
        for j in range(3):
            dj = (
                first_axes[0, j] * (y * w - z * v)
                + first_axes[1, j] * (z * u - x * w)
                + first_axes[2, j] * (x * v - y * u)
            )
            ej = -(
                second_axes[0, j] * (y * w - z * v)
                + second_axes[1, j] * (z * u - x * w)
                + second_axes[2, j] * (x * v - y * u)
            )
            if j <= i:
                hessian[3 + 3 * first + i, 3 + 3 * first + j] += stiffness * d * dj
                hessian[3 + 3 * second + i, 3 + 3 * second + j] += stiffness * e * ej
            if first > second:
                hessian[3 + 3 * first + i, 3 + 3 * second + j] += stiffness * d * ej
            else:
                hessian[3 + 3 * second + i, 3 + 3 * first + j] += stiffness * e * dj
    return 0.5 * stiffness * violation * violation


@subroutine
def add_limit(body, limit, stiffness, turns, bones, hessian, gradient):
    """Add the limit of a bone's direction to the equations; return its cost."""
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
    violation = body.limit_axes[limit, 3] - value
    if violation <= 0.0:
        return 0.0
    i = first + 2 * bone
    d0 = -(gx * far[0, 1] + gy * far[1, 1] + gz * far[2, 1])
    d1 = gx * far[0, 0] + gy * far[1, 0] + gz * far[2, 0]
    gradient[i] += stiffness * violation * d0
    gradient[i + 1] += stiffness * violation * d1
    hessian[i, i] += stiffness * d0 * d0
    hessian[i + 1, i] += stiffness * d0 * d1
    hessian[i + 1, i + 1] += stiffness * d1 * d1
    if kind == HINGE:
        near = bones[before]
        j = first + 2 * before
        e0 = -(hx * near[0, 1] + hy * near[1, 1] + hz * near[2, 1])
        e1 = hx * near[0, 0] + hy * near[1, 0] + hz * near[2, 0]
        gradient[j] += stiffness * violation * e0
        gradient[j + 1] += stiffness * violation * e1
        hessian[j, j] += stiffness * e0 * e0
        hessian[j + 1, j] += stiffness * e0 * e1
        hessian[j + 1, j + 1] += stiffness * e1 * e1
        high, low = max(i, j), min(i, j)
        for s in range(2):
            for t in range(2):
                left = (d0 if s == 0 else d1) if high == i else (e0 if s == 0 else e1)
                right = (e0 if t == 0 else e1) if high == i else (d0 if t == 0 else d1)
                hessian[high + s, low + t] += stiffness * left * right
    return 0.5 * stiffness * violation * violation
