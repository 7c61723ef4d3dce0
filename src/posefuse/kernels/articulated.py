"""People as articulated bodies: foreseen, and put right by what the views see of them.

A person's state is a pose (see :mod:`posefuse.kernels.bodies`), a shape, and the pose's velocity; its covariance has
the order pose, shape, velocity. An update is an iterated extended Kalman filter: Gauss-Newton on squared residuals of
pixels, robust by Student's t, with the prediction as prior, in pose and shape alone; velocities follow by their
correlation. See docs/methods.md, "People".
"""

import math
from collections import namedtuple

import numpy as np

from posefuse.kernels.bodies import differentiate, locate, move
from posefuse.kernels.jit import dense, inline, kernel, step
from posefuse.kernels.lens import (
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
from posefuse.kernels.symmetric import factor, invert, solve_factored

Body = namedtuple(
    "Body", "parents movers is_bone places shape_of signs starts columns keypoint_nodes limits limit_axes"
)
"""A tree as kernels take it: ``Tree.packed``, the node of each keypoint, and ``Tree.packed_limits``."""

State = namedtuple("State", "root turns bones shape velocity covariance free")
"""Of all people, by person: shape (person, 3), (person, segment, 3, 3), (person, bone, 3, 3), (person, shape),
(person, pose), (person, pose + shape + pose, the same), and (person,), int64: whether the shape is still sought."""

Law = namedtuple("Law", "scale_px exponent floor_m nu gate limit_sigma min_confidence")
"""Of detections: shape (view,), the noise of confidence 1 in px; how it falls with confidence; by how much a body's
points are not what the detector calls by their name; degrees of freedom of its tails; the largest squared innovation,
in its own covariance, that counts; how stiff joint limits are; what confidence counts."""

Room = namedtuple(
    "Room",
    "nodes jacobian noise prior hessian kept lower gradient kept_gradient change offset kept_offset weight pull "
    "weighted gain mixed root turns bones shape",
)
"""What an update works in: nodes and how they move; the noise of each observation; the prediction's information; normal
equations, as they are and of the best pose so far; the step, how far from the prediction it is; what one keypoint adds;
how velocities follow; and the best pose so far."""

USED = 0
GATED = 1
UNSEEN = 2

_HINGE = 0
_TWIST = 2

_DAMPING = 1e-3
_SMALL_STEP = 1e-2
_GROW = 10.0


@kernel
def predict_people(dt_s, decay_s, power, most, walk, state):
    """Move all people on in time: velocities fade, what is not known grows.

    Every number of the pose moves by an Ornstein-Uhlenbeck velocity of its own.

    Args:
        dt_s: shape (person,).
        decay_s: shape (pose,): in what time velocities fade.
        power: shape (pose,): spectral density of the accelerations, units^2 / s^3.
        most: shape (pose,): the largest variance of each number; what is not seen is not anywhere.
        walk: variance by which each number of a shape wanders, m^2 / s.
        state: in and out.
    """
    n = state.velocity.shape[1]
    fade = np.empty(n)
    reach = np.empty(n)
    change = np.empty(n)
    for p in range(dt_s.shape[0]):
        for i in range(n):
            fade[i] = math.exp(-dt_s[p] / decay_s[i])
            reach[i] = decay_s[i] * (1.0 - fade[i])
            change[i] = reach[i] * state.velocity[p, i]
            state.velocity[p, i] *= fade[i]
        move(change, state.root[p], state.turns[p], state.bones[p])
        _carry_on(state.covariance[p], fade, reach)
        _grow(state.covariance[p], dt_s[p], decay_s, power, fade, walk if state.free[p] != 0 else 0.0)
        _clip(state.covariance[p], most)


@step
def _carry_on(cov, fade, reach):
    """``F P F^T`` in place: numbers of the pose move by their velocities, which fade."""
    n = fade.shape[0]
    first = cov.shape[0] - n
    for i in range(n):
        for j in range(n):
            cov[i, j] += reach[i] * cov[first + i, j] + reach[j] * cov[i, first + j]
            cov[i, j] += reach[i] * reach[j] * cov[first + i, first + j]
    for i in range(n, first):
        for j in range(n):
            cov[i, j] += cov[i, first + j] * reach[j]
            cov[j, i] = cov[i, j]
    for i in range(first):
        for j in range(n):
            gain = reach[i] * cov[first + i, first + j] if i < n else 0.0
            cov[i, first + j] = (cov[i, first + j] + gain) * fade[j]
            cov[first + j, i] = cov[i, first + j]
    for i in range(n):
        for j in range(n):
            cov[first + i, first + j] *= fade[i] * fade[j]


@step
def _grow(cov, dt, decay_s, power, fade, walk):
    """What is not known grows, as accelerations of that spectral density make it."""
    n = fade.shape[0]
    first = cov.shape[0] - n
    for i in range(n):
        q = power[i]
        t = decay_s[i]
        f = fade[i]
        cov[i, i] += q * t * t * (dt - 2.0 * t * (1.0 - f) + 0.5 * t * (1.0 - f * f))
        mixed = 0.5 * q * t * t * (1.0 - f) * (1.0 - f)
        cov[i, first + i] += mixed
        cov[first + i, i] += mixed
        cov[first + i, first + i] += 0.5 * q * t * (1.0 - f * f)
    for s in range(n, first):
        cov[s, s] += walk * dt


@step
def _clip(cov, most):
    """No number is less known than that; a row and a column are made smaller together, so it stays a covariance."""
    for i in range(most.shape[0]):
        if cov[i, i] > most[i]:
            scale = math.sqrt(most[i] / cov[i, i])
            for j in range(cov.shape[0]):
                cov[i, j] *= scale
                cov[j, i] *= scale


@step
def point_covariance(jacobian, starts, columns, node, cov, out):
    """The covariance of a node, xx xy xz yy yz zz, from that of pose and shape."""
    for e in range(6):
        out[e] = 0.0
    for a in range(starts[node], starts[node + 1]):
        i = columns[a]
        x = y = z = 0.0
        for b in range(starts[node], starts[node + 1]):
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
def _look(cameras, v, points, k):
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
def _spread_px(look, cov):
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
def _px_per_m_squared(look):
    """How large a metre is seen, squared, on average over directions across the view."""
    total = look[3] ** 2 + look[4] ** 2 + look[5] ** 2 + look[6] ** 2 + look[7] ** 2 + look[8] ** 2
    return 0.5 * total


@kernel
def foresee_people(cameras, body, state, points, covariance, pixels, spread, size_px):
    """Where the views should see all people.

    Args:
        cameras: the camera array.
        body: a Body.
        state: a State.
        points: shape (person, keypoint, 3), written; NaN where the tree has no such point.
        covariance: shape (person, keypoint, 6), written: m^2.
        pixels: shape (person, view, keypoint, 2), written: NaN where a view cannot see the point.
        spread: shape (person, view, keypoint, 3), written: uu, uv, vv, px^2: by how much the pixel is not known.
        size_px: shape (person, view, keypoint), written: how many px a metre is.
    """
    n_pose = state.velocity.shape[1]
    jacobian = np.zeros((body.parents.shape[0], 3, n_pose + state.shape.shape[1]))
    nodes = np.empty((body.parents.shape[0], 3))
    b = body
    for p in range(state.root.shape[0]):
        turns, bones, shape = state.turns[p], state.bones[p], state.shape[p]
        locate(b.parents, b.movers, b.is_bone, b.places, b.shape_of, b.signs, state.root[p], turns, bones, shape, nodes)
        differentiate(
            b.parents, b.movers, b.is_bone, b.places, b.shape_of, b.signs, n_pose, turns, bones, shape, jacobian
        )
        for k in range(b.keypoint_nodes.shape[0]):
            node = b.keypoint_nodes[k]
            if node < 0:
                for i in range(3):
                    points[p, k, i] = math.nan
                for i in range(6):
                    covariance[p, k, i] = math.nan
                for v in range(cameras.shape[0]):
                    pixels[p, v, k, 0] = math.nan
                    pixels[p, v, k, 1] = math.nan
                continue
            for i in range(3):
                points[p, k, i] = nodes[node, i]
            point_covariance(jacobian, b.starts, b.columns, node, state.covariance[p], covariance[p, k])
            for v in range(cameras.shape[0]):
                look = _look(cameras, v, nodes, node)
                pixels[p, v, k, 0] = look[1]
                pixels[p, v, k, 1] = look[2]
                uu, uv, vv = _spread_px(look, covariance[p, k])
                spread[p, v, k, 0] = uu
                spread[p, v, k, 1] = uv
                spread[p, v, k, 2] = vv
                size_px[p, v, k] = math.sqrt(_px_per_m_squared(look))


@inline
def noise_growth(trust, exponent):
    """By how much the variance of a detection of that confidence is larger; without one it is as good as the best."""
    if trust != trust or exponent <= 0.0:
        return 1.0
    least = max(trust, 0.05)
    return 1.0 / (least * least) if exponent == 1.0 else least ** (-2.0 * exponent)


@inline
def _noise_squared(law, v, trust, look):
    """The variance of a detection, px^2 per axis."""
    scale = law.scale_px[v] * law.scale_px[v] * noise_growth(trust, law.exponent)
    return scale + law.floor_m * law.floor_m * _px_per_m_squared(look)


@step
def _gate(cameras, body, law, rows, labels, keypoints_px, confidence, nodes, jacobian, cov, packed, use, noise):
    """Which observations count, how noisy each is, and how surprising they are, before any has moved the body."""
    total = 0.0
    for k in range(body.keypoint_nodes.shape[0]):
        node = body.keypoint_nodes[k]
        if node >= 0:
            point_covariance(jacobian, body.starts, body.columns, node, cov, packed)
        for v in range(cameras.shape[0]):
            use[v, k] = UNSEEN
            if node < 0 or rows[v] < 0 or labels[v, k] < 0:
                continue
            trust = confidence[rows[v], labels[v, k]]
            pixel_u = keypoints_px[rows[v], labels[v, k], 0]
            pixel_v = keypoints_px[rows[v], labels[v, k], 1]
            if not math.isfinite(pixel_u + pixel_v) or trust < law.min_confidence:
                continue
            look = _look(cameras, v, nodes, node)
            if look[0] != OK:
                continue
            noise[v, k] = _noise_squared(law, v, trust, look)
            uu, uv, vv = _spread_px(look, packed)
            uu += noise[v, k]
            vv += noise[v, k]
            du = pixel_u - look[1]
            dv = pixel_v - look[2]
            squared = (vv * du * du - 2.0 * uv * du * dv + uu * dv * dv) / (uu * vv - uv * uv)
            use[v, k] = USED if squared <= law.gate else GATED
            if use[v, k] == USED:
                total += squared
    return total


@inline
def _clear(matrix, vector, n):
    for i in range(n):
        vector[i] = 0.0
        for j in range(i + 1):
            matrix[i, j] = 0.0


@step
def _add_keypoint(jacobian, starts, columns, node, m, weight, pull, hessian, gradient, weighted):
    """What one keypoint, with its information ``weight`` (packed) and its ``pull``, says of pose and shape."""
    for a in range(starts[node], starts[node + 1]):
        i = columns[a]
        x, y, z = jacobian[node, 0, i], jacobian[node, 1, i], jacobian[node, 2, i]
        if i < m:
            gradient[i] += x * pull[0] + y * pull[1] + z * pull[2]
        weighted[0, i] = weight[0] * x + weight[1] * y + weight[2] * z
        weighted[1, i] = weight[1] * x + weight[3] * y + weight[4] * z
        weighted[2, i] = weight[2] * x + weight[4] * y + weight[5] * z
    for a in range(starts[node], starts[node + 1]):
        i = columns[a]
        if i >= m:
            break
        x, y, z = jacobian[node, 0, i], jacobian[node, 1, i], jacobian[node, 2, i]
        for b in range(starts[node], a + 1):
            j = columns[b]
            hessian[i, j] += x * weighted[0, j] + y * weighted[1, j] + z * weighted[2, j]


@step
def _add_views(
    cameras,
    body,
    law,
    calm,
    rows,
    labels,
    keypoints_px,
    use,
    noise,
    nodes,
    jacobian,
    m,
    weight,
    pull,
    hessian,
    gradient,
    weighted,
):
    """Normal equations of all observations that count; what they cost."""
    cost = 0.0
    for k in range(body.keypoint_nodes.shape[0]):
        node = body.keypoint_nodes[k]
        any_view = False
        for e in range(6):
            weight[e] = 0.0
        for e in range(3):
            pull[e] = 0.0
        for v in range(cameras.shape[0]):
            if use[v, k] != USED:
                continue
            look = _look(cameras, v, nodes, node)
            if look[0] != OK:
                continue
            du = keypoints_px[rows[v], labels[v, k], 0] - look[1]
            dv = keypoints_px[rows[v], labels[v, k], 1] - look[2]
            squared = (du * du + dv * dv) / noise[v, k]
            cost += calm * 0.5 * (law.nu + 2.0) * math.log(1.0 + squared / law.nu)
            w = calm * (law.nu + 2.0) / (law.nu + squared) / noise[v, k]
            weight[0] += w * (look[3] * look[3] + look[6] * look[6])
            weight[1] += w * (look[3] * look[4] + look[6] * look[7])
            weight[2] += w * (look[3] * look[5] + look[6] * look[8])
            weight[3] += w * (look[4] * look[4] + look[7] * look[7])
            weight[4] += w * (look[4] * look[5] + look[7] * look[8])
            weight[5] += w * (look[5] * look[5] + look[8] * look[8])
            pull[0] += w * (look[3] * du + look[6] * dv)
            pull[1] += w * (look[4] * du + look[7] * dv)
            pull[2] += w * (look[5] * du + look[8] * dv)
            any_view = True
        if any_view:
            _add_keypoint(jacobian, body.starts, body.columns, node, m, weight, pull, hessian, gradient, weighted)
    return cost


@step
def _add_twist(body, limit, stiffness, turns, hessian, gradient):
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
def _add_limit(body, limit, stiffness, turns, bones, hessian, gradient):
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
    if kind == _HINGE:
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
    if kind == _HINGE:
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


@dense
def _condition(prior, offset, m, hessian, gradient):
    """Add the prediction as prior; what the offset from it costs."""
    cost = 0.0
    for i in range(m):
        pulled = 0.0
        for j in range(m):
            pulled += prior[i, j] * offset[j]
        for j in range(i + 1):
            hessian[i, j] += prior[i, j]
        gradient[i] -= pulled
        cost += 0.5 * offset[i] * pulled
    return cost


@inline
def _multiply(left, first, right, rows, m, out):
    """``out = left[first:] right``, of ``rows`` rows and ``m`` columns."""
    for i in range(rows):
        for j in range(m):
            out[i, j] = 0.0
        for k in range(m):
            by = left[first + i, k]
            for j in range(m):
                out[i, j] += by * right[k, j]


@dense
def _spread_to_velocities(cov, prior, posterior, offset, n, m, velocity, gain, mixed):
    """Velocities and their covariance, from how pose and shape moved and what is known of them now.

    With G = P_va P_aa^-1: velocities move by G times the offset, P_va becomes G P_aa', P_vv loses G (P_aa - P_aa') G^T.
    """
    first = cov.shape[0] - n
    _multiply(cov, first, prior, n, m, gain)
    _multiply(gain, 0, posterior, n, m, mixed)
    for i in range(n):
        for j in range(m):
            velocity[i] += gain[i, j] * offset[j]
        for j in range(i + 1):
            total = 0.0
            for k in range(m):
                total += (mixed[i, k] - cov[first + i, k]) * gain[j, k]
            cov[first + i, first + j] += total
            cov[first + j, first + i] = cov[first + i, first + j]
    _store(cov, posterior, mixed, first, n, m)


@inline
def _store(cov, posterior, mixed, first, n, m):
    for i in range(n):
        for j in range(m):
            cov[first + i, j] = mixed[i, j]
            cov[j, first + i] = mixed[i, j]
    for i in range(m):
        for j in range(m):
            cov[i, j] = posterior[i, j]


@inline
def _copy(source, target):
    for i in range(target.shape[0]):
        target[i] = source[i]


@inline
def _copy_frames(source, target):
    for s in range(target.shape[0]):
        for i in range(3):
            for j in range(3):
                target[s, i, j] = source[s, i, j]


@step
def _copy_pose(root, turns, bones, shape, to_root, to_turns, to_bones, to_shape):
    """Copy a pose and a shape."""
    _copy(root, to_root)
    _copy_frames(turns, to_turns)
    _copy_frames(bones, to_bones)
    _copy(shape, to_shape)


@inline
def _copy_triangle(source, m, target):
    for i in range(m):
        for j in range(i + 1):
            target[i, j] = source[i, j]


@step
def _step_from(hessian, gradient, damping, m, lower, change):
    """The damped Gauss-Newton step; how far it is, squared, in units of what is known."""
    _copy_triangle(hessian, m, lower)
    for i in range(m):
        lower[i, i] *= 1.0 + damping
        change[i] = gradient[i]
    size = 0.0
    if factor(lower, m):
        solve_factored(lower, m, change)
        for i in range(m):
            size += change[i] * gradient[i]
    else:
        for i in range(m):
            change[i] = 0.0
    return size


@kernel
def update_people(
    cameras, body, law, temper, iterations, rows, labels, keypoints_px, confidence, state, use, moved, surprise
):
    """Put all people right by what the views see of them.

    Args:
        cameras: the camera array.
        body: a Body.
        law: a Law.
        temper: shape (person,): as how many independent ones so many frames' detections count as one, because their
            errors last.
        iterations: of Gauss-Newton, at most.
        rows: shape (person, view), int64: rows of the detections, -1 where none.
        labels: shape (person, view, keypoint), int64: which of a detection's keypoints is the body's; -1 none.
        keypoints_px: shape (row, keypoint, 2).
        confidence: shape (row, keypoint).
        state: a State, in and out.
        use: shape (person, view, keypoint), int64, written: USED, GATED or UNSEEN.
        moved: shape (person,), written: by how much the prediction was off, squared, in its own covariance; NaN where
            that is broken: then they are nowhere any more, and no view shows them.
        surprise: shape (person,), written: squared innovations of the keypoints that count, each in its own
            covariance, together: two for each, if all is as sure as it says. NaN likewise.
    """
    n_people, n = state.velocity.shape
    h = state.shape.shape[1]
    size, n_views, n_keypoints = n + h, cameras.shape[0], body.keypoint_nodes.shape[0]
    room = Room(
        nodes=np.empty((body.parents.shape[0], 3)),
        jacobian=np.zeros((body.parents.shape[0], 3, size)),
        noise=np.empty((n_views, n_keypoints)),
        prior=np.empty((size, size)),
        hessian=np.empty((size, size)),
        kept=np.empty((size, size)),
        lower=np.empty((size, size)),
        gradient=np.empty(size),
        kept_gradient=np.empty(size),
        change=np.empty(size),
        offset=np.empty(size),
        kept_offset=np.empty(size),
        weight=np.empty(6),
        pull=np.empty(3),
        weighted=np.empty((3, size)),
        gain=np.empty((n, size)),
        mixed=np.empty((n, size)),
        root=np.empty(3),
        turns=np.empty((state.turns.shape[1], 3, 3)),
        bones=np.empty((state.bones.shape[1], 3, 3)),
        shape=np.empty(h),
    )
    for p in range(n_people):
        m = size if state.free[p] != 0 else n
        cov = state.covariance[p]
        moved[p] = math.nan
        _copy_triangle(cov, m, room.prior)
        if not invert(room.prior, m, room.change):
            use[p, :, :] = UNSEEN
            surprise[p] = math.nan
            state.root[p, :] = math.nan
            continue
        surprise[p] = _settle(
            cameras, body, law, temper[p], iterations, rows[p], labels[p], keypoints_px, confidence, state.root[p],
            state.turns[p], state.bones[p], state.shape[p], cov, n, m, use[p], room,
        )  # fmt: skip
        moved[p] = _spread(cov, n, m, state.velocity[p], room)


@step
def _linearise(cameras, body, law, calm, rows, labels, keypoints_px, use, turns, bones, m, room):
    """Normal equations of a pose and shape, into the room; what they cost."""
    _clear(room.hessian, room.gradient, m)
    total = _condition(room.prior, room.offset, m, room.hessian, room.gradient)
    total += _add_views(
        cameras, body, law, calm, rows, labels, keypoints_px, use, room.noise, room.nodes, room.jacobian, m,
        room.weight, room.pull, room.hessian, room.gradient, room.weighted,
    )  # fmt: skip
    stiffness = law.limit_sigma**-2.0
    for limit in range(body.limits.shape[0]):
        if body.limits[limit, 0] == _TWIST:
            total += _add_twist(body, limit, stiffness, turns, room.hessian, room.gradient)
        else:
            total += _add_limit(body, limit, stiffness, turns, bones, room.hessian, room.gradient)
    return total


@step
def _settle(
    cameras, body, law, temper, iterations, rows, labels, keypoints_px, confidence, root, turns, bones, shape, cov, n,
    m, use, room,
):  # fmt: skip
    """Damped Gauss-Newton from the prediction: how surprising what was seen is; the rest in the room."""
    b = body
    for i in range(m):
        room.offset[i] = 0.0
    damping, before, surprise = 0.0, math.inf, 0.0
    for turn in range(iterations + 1):
        locate(b.parents, b.movers, b.is_bone, b.places, b.shape_of, b.signs, root, turns, bones, shape, room.nodes)
        differentiate(
            b.parents, b.movers, b.is_bone, b.places, b.shape_of, b.signs, n, turns, bones, shape, room.jacobian
        )
        if turn == 0:
            surprise = _gate(
                cameras, b, law, rows, labels, keypoints_px, confidence, room.nodes, room.jacobian, cov, room.weight,
                use, room.noise,
            )  # fmt: skip
        total = _linearise(cameras, b, law, 1.0 / temper, rows, labels, keypoints_px, use, turns, bones, m, room)
        if total <= before + 1e-9 * abs(before):
            before = total
            damping /= _GROW
            _copy_triangle(room.hessian, m, room.kept)
            _copy(room.gradient, room.kept_gradient)
            _copy(room.offset, room.kept_offset)
            _copy_pose(root, turns, bones, shape, room.root, room.turns, room.bones, room.shape)
        else:
            # Too far: back, and a shorter step from there.
            damping = max(_DAMPING, damping * _GROW)
            _copy_pose(room.root, room.turns, room.bones, room.shape, root, turns, bones, shape)
            _copy(room.kept_offset, room.offset)
        if turn == iterations:
            break
        size = _step_from(room.kept, room.kept_gradient, damping, m, room.lower, room.change)
        move(room.change, root, turns, bones)
        for i in range(m - n):
            shape[i] += room.change[n + i]
        for i in range(m):
            room.offset[i] += room.change[i]
        if size < _SMALL_STEP and damping < _DAMPING:
            break
    return surprise


@step
def _spread(cov, n, m, velocity, room):
    """The covariance after an update and the velocities; by how much the prediction was off."""
    off = 0.0
    for i in range(m):
        for j in range(m):
            off += room.offset[i] * room.prior[i, j] * room.offset[j]
    _copy_triangle(room.kept, m, room.hessian)
    if invert(room.hessian, m, room.change):
        _spread_to_velocities(cov, room.prior, room.hessian, room.offset, n, m, velocity, room.gain, room.mixed)
    return off
