"""People as articulated bodies: foreseen, and put right by what the views see of them.

A person's state is a pose (see :mod:`posefuse.kernels.tracking.bodies`), a shape, and the pose's velocity; its covariance has
the order pose, shape, velocity. An update is an iterated extended Kalman filter: Gauss-Newton on squared residuals of
pixels, robust by Student's t, with the prediction as prior, in pose and shape alone; velocities follow by their
correlation. See docs/methods.md, "People".
"""

import math
from collections import namedtuple

import numpy as np

from posefuse.kernels.cameras.lens import OK
from posefuse.kernels.jit import dense, inline, kernel, step
from posefuse.kernels.linear_algebra.symmetric import factor, invert, multiply, solve_factored, subtract_products
from posefuse.kernels.tracking.bodies import differentiate, locate, move
from posefuse.kernels.tracking.joint_limits import TWIST, add_limit, add_twist
from posefuse.kernels.tracking.point_observations import look_at_point, point_covariance, px_per_m_squared, spread_px

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
        carry_on(state.covariance[p], fade, reach)
        grow(state.covariance[p], dt_s[p], decay_s, power, fade, walk if state.free[p] != 0 else 0.0)
        clip(state.covariance[p], most)


@step
def carry_on(cov, fade, reach):
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
def grow(cov, dt, decay_s, power, fade, walk):
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
def clip(cov, most):
    """No number is less known than that; a row and a column are made smaller together, so it stays a covariance."""
    for i in range(most.shape[0]):
        if cov[i, i] > most[i]:
            scale = math.sqrt(most[i] / cov[i, i])
            for j in range(cov.shape[0]):
                cov[i, j] *= scale
                cov[j, i] *= scale


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
        m = n_pose + (shape.shape[0] if state.free[p] != 0 else 0)
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
            point_covariance(jacobian, b.starts, b.columns, node, m, state.covariance[p], covariance[p, k])
            for v in range(cameras.shape[0]):
                look = look_at_point(cameras, v, nodes, node)
                pixels[p, v, k, 0] = look[1]
                pixels[p, v, k, 1] = look[2]
                uu, uv, vv = spread_px(look, covariance[p, k])
                spread[p, v, k, 0] = uu
                spread[p, v, k, 1] = uv
                spread[p, v, k, 2] = vv
                size_px[p, v, k] = math.sqrt(px_per_m_squared(look))


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
    return scale + law.floor_m * law.floor_m * px_per_m_squared(look)


@step
def _gate(cameras, body, law, rows, labels, keypoints_px, confidence, nodes, jacobian, m, cov, packed, use, noise):
    """Which observations count, how noisy each is, and how surprising they are, before any has moved the body."""
    total = 0.0
    for k in range(body.keypoint_nodes.shape[0]):
        node = body.keypoint_nodes[k]
        if node >= 0:
            point_covariance(jacobian, body.starts, body.columns, node, m, cov, packed)
        for v in range(cameras.shape[0]):
            use[v, k] = UNSEEN
            if node < 0 or rows[v] < 0 or labels[v, k] < 0:
                continue
            trust = confidence[rows[v], labels[v, k]]
            pixel_u = keypoints_px[rows[v], labels[v, k], 0]
            pixel_v = keypoints_px[rows[v], labels[v, k], 1]
            if not math.isfinite(pixel_u + pixel_v) or trust < law.min_confidence:
                continue
            look = look_at_point(cameras, v, nodes, node)
            if look[0] != OK:
                continue
            noise[v, k] = _noise_squared(law, v, trust, look)
            uu, uv, vv = spread_px(look, packed)
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
        if i >= m:
            break
        x, y, z = jacobian[node, 0, i], jacobian[node, 1, i], jacobian[node, 2, i]
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
            look = look_at_point(cameras, v, nodes, node)
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


@dense
def spread_to_velocities(cov, prior, posterior, offset, n, m, velocity, gain, mixed):
    """Velocities and their covariance, from how pose and shape moved and what is known of them now.

    With G = P_va P_aa^-1: velocities move by G times the offset, P_va becomes G P_aa', P_vv loses G (P_aa - P_aa') G^T.
    """
    first = cov.shape[0] - n
    multiply(cov, first, prior, n, m, gain)
    multiply(gain, 0, posterior, n, m, mixed)
    for i in range(n):
        for j in range(m):
            velocity[i] += gain[i, j] * offset[j]
            cov[first + i, j] -= mixed[i, j]
    subtract_products(cov, first, gain, n, m)
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
def copy_frames(source, target):
    """Copy axes of bodies' parts, shape (part, 3, 3)."""
    for s in range(target.shape[0]):
        for i in range(3):
            for j in range(3):
                target[s, i, j] = source[s, i, j]


@step
def _copy_pose(root, turns, bones, shape, to_root, to_turns, to_bones, to_shape):
    """Copy a pose and a shape."""
    _copy(root, to_root)
    copy_frames(turns, to_turns)
    copy_frames(bones, to_bones)
    _copy(shape, to_shape)


@inline
def copy_triangle(source, m, target):
    """Copy the lower triangle of the first ``m`` rows."""
    for i in range(m):
        for j in range(i + 1):
            target[i, j] = source[i, j]


@step
def _step_from(hessian, gradient, damping, m, lower, change):
    """The damped Gauss-Newton step; how far it is, squared, in units of what is known."""
    copy_triangle(hessian, m, lower)
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
        copy_triangle(cov, m, room.prior)
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
        if body.limits[limit, 0] == TWIST:
            total += add_twist(body, limit, stiffness, turns, room.hessian, room.gradient)
        else:
            total += add_limit(body, limit, stiffness, turns, bones, room.hessian, room.gradient)
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
                cameras, b, law, rows, labels, keypoints_px, confidence, room.nodes, room.jacobian, m, cov,
                room.weight, use, room.noise,
            )  # fmt: skip
        total = _linearise(cameras, b, law, 1.0 / temper, rows, labels, keypoints_px, use, turns, bones, m, room)
        if total <= before + 1e-9 * abs(before):
            before = total
            damping /= _GROW
            copy_triangle(room.hessian, m, room.kept)
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
    copy_triangle(room.kept, m, room.hessian)
    if invert(room.hessian, m, room.change):
        spread_to_velocities(cov, room.prior, room.hessian, room.offset, n, m, velocity, room.gain, room.mixed)
    return off
