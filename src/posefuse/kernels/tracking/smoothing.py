"""What later frames say of bodies in earlier ones: gains and means of a Rauch-Tung-Striebel smoother.

States are those of :mod:`posefuse.kernels.tracking.articulated`, of one person, with frames where people stand there.
"""

import math

import numpy as np

from posefuse.kernels.jit import kernel, step
from posefuse.kernels.linear_algebra.rotations import turn_between
from posefuse.kernels.linear_algebra.symmetric import invert
from posefuse.kernels.tracking.bodies import move
from posefuse.kernels.tracking.predict import Foretold, covariance_ahead, fade_over, foretell, growth


@step
def tilt_between(start, end):
    """The turn about the first two axes of ``start`` that takes its third axis to that of ``end``, in radians."""
    x = y = z = 0.0
    for i in range(3):
        x += start[i, 0] * end[i, 2]
        y += start[i, 1] * end[i, 2]
        z += start[i, 2] * end[i, 2]
    across = math.hypot(x, y)
    scale = 1.0 if across < 1e-12 else math.atan2(across, z) / across
    return -scale * y, scale * x


@step
def difference(start, p, end, q, change):
    """The change of pose, shape and velocity that makes state ``p`` of ``start`` state ``q`` of ``end``.

    Args:
        change: shape (pose + shape + pose,), written; the inverse of ``move``.
    """
    for i in range(3):
        change[i] = end.root[q, i] - start.root[p, i]
    for s in range(start.turns.shape[1]):
        c = 3 + 3 * s
        change[c], change[c + 1], change[c + 2] = turn_between(start.turns[p, s], end.turns[q, s])
    first = 3 + 3 * start.turns.shape[1]
    for b in range(start.bones.shape[1]):
        c = first + 2 * b
        change[c], change[c + 1] = tilt_between(start.bones[p, b], end.bones[q, b])
    n, h = start.velocity.shape[1], start.shape.shape[1]
    for i in range(h):
        change[n + i] = end.shape[q, i] - start.shape[p, i]
    for i in range(n):
        change[n + h + i] = end.velocity[q, i] - start.velocity[p, i]


@kernel
def compare_states(start, end, change):
    """For each frame the change that makes one state the other, shape (frame, pose + shape + pose), written."""
    for k in range(change.shape[0]):
        difference(start, k, end, k, change[k])


@kernel
def apply_changes(change, state):
    """Change each frame's pose, shape and velocity, shape (frame, pose + shape + pose), in place."""
    n, h = state.velocity.shape[1], state.shape.shape[1]
    for k in range(change.shape[0]):
        move(change[k, :n], state.root[k], state.turns[k], state.bones[k])
        for i in range(h):
            state.shape[k, i] += change[k, n + i]
        for i in range(n):
            state.velocity[k, i] += change[k, n + h + i]


@kernel
def gains_back(dt_s, decay_s, power, walk, state, gains, rest):
    """The smoother's gains, and what later frames can never tell.

    With P the covariance of a state, F what moves it on, Q what grows meanwhile and P' = F P F^T + Q, the gain is
    G = P F^T P'^-1 = F^-1 (1 - Q P'^-1) and the rest P - G P' G^T = G Q F^-T. F and Q mix each number with its velocity
    alone, so that but for one inverse all this is a few operations a number. F is divided by: velocities must not fade
    away within a frame.

    Args:
        dt_s: shape (frame,): to the next.
        decay_s: shape (pose,): in what time velocities fade.
        power: shape (pose,): spectral density of the accelerations.
        walk: variance by which each number of a shape wanders, m^2 / s.
        state: a State with frames, filtered; at least as many.
        gains: shape (frame, row, row), written: of (pose, shape where it is sought, velocity).
        rest: shape (frame, row, row), written.

    Returns:
        How many frames are done: fewer than all where rounding left a covariance that is none.
    """
    n, rows = state.velocity.shape[1], gains.shape[1]
    m = rows - n
    inverse = np.empty((rows, rows))
    fade, reach, row = np.empty(n), np.empty(n), np.empty(rows)
    for k in range(gains.shape[0]):
        dt = dt_s[k]
        fade_over(dt, decay_s, fade, reach)
        covariance_ahead(state.covariance[k], dt, decay_s, power, fade, reach, walk, m, rows, inverse)
        if not invert(inverse, rows, row):
            return k
        _gain(inverse, dt, decay_s, power, fade, reach, walk, m, gains[k])
        _rest(gains[k], dt, decay_s, power, fade, reach, walk, m, rest[k])
    return gains.shape[0]


@step
def _gain(inverse, dt, decay_s, power, fade, reach, walk, m, out):
    """``F^-1 (1 - Q inverse)``."""
    n, rows = fade.shape[0], inverse.shape[0]
    for i in range(n):
        place, mixed, fast = growth(dt, decay_s[i], power[i], fade[i])
        back = reach[i] / fade[i]
        for j in range(rows):
            one = (1.0 if i == j else 0.0) - place * inverse[i, j] - mixed * inverse[m + i, j]
            other = (1.0 if m + i == j else 0.0) - mixed * inverse[i, j] - fast * inverse[m + i, j]
            out[i, j] = one - back * other
            out[m + i, j] = other / fade[i]
    for i in range(n, m):
        for j in range(rows):
            out[i, j] = (1.0 if i == j else 0.0) - walk * dt * inverse[i, j]


@step
def _rest(gain, dt, decay_s, power, fade, reach, walk, m, out):
    """``gain Q F^-T``, which is symmetric."""
    n, rows = fade.shape[0], gain.shape[0]
    for j in range(n):
        place, mixed, fast = growth(dt, decay_s[j], power[j], fade[j])
        back = reach[j] / fade[j]
        for i in range(rows):
            one = gain[i, j] * place + gain[i, m + j] * mixed
            other = gain[i, j] * mixed + gain[i, m + j] * fast
            out[i, j] = one - back * other
            out[i, m + j] = other / fade[j]
    for j in range(n, m):
        for i in range(rows):
            out[i, j] = gain[i, j] * walk * dt
    for i in range(rows):
        for j in range(i):
            mean = 0.5 * (out[i, j] + out[j, i])
            out[i, j] = mean
            out[j, i] = mean


@kernel
def carry_back(gains, rows, dt_s, decay_s, state):
    """Correct the means of frames by what came after, last frame first.

    Args:
        gains: shape (frame, row, row): of the smoother, from each frame's successor.
        rows: shape (row,), int64: which numbers of (pose, shape, velocity) the gains are of; others stay.
        dt_s: shape (frame,): to the next.
        decay_s: shape (pose,): in what time velocities fade.
        state: a State, filtered, in; smoothed, out: one frame more than the gains; the last is smoothed already.
    """
    n, h = state.velocity.shape[1], state.shape.shape[1]
    fade, reach = np.empty(n), np.empty(n)
    late, correction = np.empty(2 * n + h), np.empty(2 * n + h)
    foretold = Foretold(
        np.empty((1, 3)), np.empty((1, state.turns.shape[1], 3, 3)), np.empty((1, state.bones.shape[1], 3, 3)),
        np.empty((1, h)), np.empty((1, n)),
    )  # fmt: skip
    for k in range(gains.shape[0] - 1, -1, -1):
        fade_over(dt_s[k], decay_s, fade, reach)
        foretell(state, k, fade, reach, correction, foretold)
        difference(foretold, 0, state, k + 1, late)
        for i in range(correction.shape[0]):
            correction[i] = 0.0
        for a in range(rows.shape[0]):
            total = 0.0
            for b in range(rows.shape[0]):
                total += gains[k, a, b] * late[rows[b]]
            correction[rows[a]] = total
        move(correction[:n], state.root[k], state.turns[k], state.bones[k])
        for i in range(h):
            state.shape[k, i] += correction[n + i]
        for i in range(n):
            state.velocity[k, i] += correction[n + h + i]


@kernel
def add_information(information, share, free, n_pose, covariance):
    """``(P^-1 + share I)^-1`` in place of the covariances of pose and shape.

    Args:
        information: shape (frame, pose + shape, pose + shape).
        share: of it that is added.
        free: shape (frame,), int64: 0 where the shape is kept, of which nothing is not known.
        n_pose: numbers of the pose.
        covariance: shape (frame, pose + shape + pose, the same), in and out.

    Returns:
        How many frames are done: fewer than all where rounding left a covariance that is none.
    """
    size = information.shape[1]
    inverse, row = np.empty((size, size)), np.empty(size)
    for k in range(free.shape[0]):
        m = size if free[k] != 0 else n_pose
        for i in range(m):
            for j in range(i + 1):
                inverse[i, j] = covariance[k, i, j]
        if not invert(inverse, m, row):
            return k
        for i in range(m):
            for j in range(i + 1):
                inverse[i, j] += share * information[k, i, j]
        if not invert(inverse, m, row):
            return k
        for i in range(m):
            for j in range(m):
                covariance[k, i, j] = inverse[i, j]
    return free.shape[0]
