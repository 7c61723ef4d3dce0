"""Rauch-Tung-Striebel smoother for articulated bodies: gains, means and covariances.

States are those of :mod:`posefuse.kernels.tracking.records`, of one person, with frames on the person axis.
"""

import math

import numpy as np

from posefuse.kernels.jit import kernel, subroutine
from posefuse.kernels.linear_algebra.rotations import rotation_between
from posefuse.kernels.linear_algebra.symmetric import invert
from posefuse.kernels.tracking.body_kinematics import apply_increment
from posefuse.kernels.tracking.predict import (
    PredictedState,
    predict_covariance,
    predict_state,
    process_noise,
    velocity_decay,
)


@subroutine
def tilt_between(start, end):
    """Return the rotation (radians) about the first two axes of ``start`` that aligns its third axis with ``end``."""
    x = y = z = 0.0
    for i in range(3):
        x += start[i, 0] * end[i, 2]
        y += start[i, 1] * end[i, 2]
        z += start[i, 2] * end[i, 2]
    horizontal = math.hypot(x, y)
    scale = 1.0 if horizontal < 1e-12 else math.atan2(horizontal, z) / horizontal
    return -scale * y, scale * x


@subroutine
def state_difference(start, p, end, q, change):
    """Write the change of pose, shape and velocity from state ``p`` of ``start`` to state ``q`` of ``end``.

    Args:
        start: a State.
        p: its frame.
        end: a State.
        q: its frame.
        change: shape (pose + shape + pose,), written; the inverse of ``apply_increment``.
    """
    for i in range(3):
        change[i] = end.root[q, i] - start.root[p, i]
    for s in range(start.turns.shape[1]):
        c = 3 + 3 * s
        change[c], change[c + 1], change[c + 2] = rotation_between(start.turns[p, s], end.turns[q, s])
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
    """Write the change from one state to the other for each frame, shape (frame, pose + shape + pose)."""
    for k in range(change.shape[0]):
        state_difference(start, k, end, k, change[k])


@kernel
def apply_changes(change, state):
    """Change pose, shape and velocity of each frame, shape (frame, pose + shape + pose), in place."""
    n, h = state.velocity.shape[1], state.shape.shape[1]
    for k in range(change.shape[0]):
        apply_increment(change[k, :n], state.root[k], state.turns[k], state.bones[k])
        for i in range(h):
            state.shape[k, i] += change[k, n + i]
        for i in range(n):
            state.velocity[k, i] += change[k, n + h + i]


@kernel
def smoother_gains(dt_s, motion, state, gains, remainder):
    """Compute the gains of the smoother and the covariance that later frames cannot reduce.

    With P the covariance of a state, F its transition, Q the process noise and P' = F P F^T + Q, the gain is
    G = P F^T P'^-1 = F^-1 (1 - Q P'^-1) and the remainder P - G P' G^T = G Q F^-T. F and Q couple each number only with
    its velocity, so apart from one inverse all this takes a few operations per number. F is inverted: velocities must
    not decay completely within a frame.

    Args:
        dt_s: shape (frame,): time to the next frame.
        motion: a MotionModel; variances are not limited.
        state: a State, filtered; at least as many frames as gains.
        gains: shape (frame, row, row), written: of (pose, shape if it is estimated, velocity).
        remainder: shape (frame, row, row), written.

    Returns:
        Number of completed frames; fewer than all if rounding made a covariance indefinite.
    """
    n, rows = state.velocity.shape[1], gains.shape[1]
    m = rows - n
    inverse = np.empty((rows, rows))
    decay, reach, scratch = np.empty(n), np.empty(n), np.empty(2 * rows)
    for k in range(gains.shape[0]):
        dt = dt_s[k]
        velocity_decay(dt, motion.decay_s, decay, reach)
        predict_covariance(state.covariance[k], dt, motion, decay, reach, m, rows, inverse)
        if not invert(inverse, rows, scratch):
            return k
        _gain(inverse, dt, motion, decay, reach, m, gains[k])
        _remainder(gains[k], dt, motion, decay, reach, m, remainder[k])
    return gains.shape[0]


@subroutine
def _gain(inverse, dt, motion, decay, reach, m, out):
    """Write ``F^-1 (1 - Q inverse)``."""
    decay_s, power, walk = motion.decay_s, motion.power, motion.walk
    n, rows = decay.shape[0], inverse.shape[0]
    for i in range(n):
        position, cross, velocity = process_noise(dt, decay_s[i], power[i], decay[i])
        back = reach[i] / decay[i]
        for j in range(rows):
            one = (1.0 if i == j else 0.0) - position * inverse[i, j] - cross * inverse[m + i, j]
            other = (1.0 if m + i == j else 0.0) - cross * inverse[i, j] - velocity * inverse[m + i, j]
            out[i, j] = one - back * other
            out[m + i, j] = other / decay[i]
    for i in range(n, m):
        for j in range(rows):
            out[i, j] = (1.0 if i == j else 0.0) - walk * dt * inverse[i, j]


@subroutine
def _remainder(gain, dt, motion, decay, reach, m, out):
    """Write the symmetric matrix ``gain Q F^-T``."""
    decay_s, power, walk = motion.decay_s, motion.power, motion.walk
    n, rows = decay.shape[0], gain.shape[0]
    for j in range(n):
        position, cross, velocity = process_noise(dt, decay_s[j], power[j], decay[j])
        back = reach[j] / decay[j]
        for i in range(rows):
            one = gain[i, j] * position + gain[i, m + j] * cross
            other = gain[i, j] * cross + gain[i, m + j] * velocity
            out[i, j] = one - back * other
            out[i, m + j] = other / decay[j]
    for j in range(n, m):
        for i in range(rows):
            out[i, j] = gain[i, j] * walk * dt
    for i in range(rows):
        for j in range(i):
            mean = 0.5 * (out[i, j] + out[j, i])
            out[i, j] = mean
            out[j, i] = mean


@kernel
def smooth_means(gains, rows, dt_s, decay_s, state):
    """Correct the means of frames by later frames, last frame first.

    Args:
        gains: shape (frame, row, row): from the successor of each frame.
        rows: shape (row,), int64: the numbers of (pose, shape, velocity) that the gains cover; others stay unchanged.
        dt_s: shape (frame,): time to the next frame.
        decay_s: shape (pose,): time constant of the velocity decay.
        state: a State, filtered on input and smoothed on output; one frame more than the gains, the last already
            smoothed.
    """
    n, h = state.velocity.shape[1], state.shape.shape[1]
    decay, reach = np.empty(n), np.empty(n)
    deviation, correction = np.empty(2 * n + h), np.empty(2 * n + h)
    predicted = PredictedState(
        np.empty((1, 3)), np.empty((1, state.turns.shape[1], 3, 3)), np.empty((1, state.bones.shape[1], 3, 3)),
        np.empty((1, h)), np.empty((1, n)),
    )  # fmt: skip
    for k in range(gains.shape[0] - 1, -1, -1):
        velocity_decay(dt_s[k], decay_s, decay, reach)
        predict_state(state, k, decay, reach, correction, predicted)
        state_difference(predicted, 0, state, k + 1, deviation)
        for i in range(correction.shape[0]):
            correction[i] = 0.0
        for a in range(rows.shape[0]):
            total = 0.0
            for b in range(rows.shape[0]):
                total += gains[k, a, b] * deviation[rows[b]]
            correction[rows[a]] = total
        apply_increment(correction[:n], state.root[k], state.turns[k], state.bones[k])
        for i in range(h):
            state.shape[k, i] += correction[n + i]
        for i in range(n):
            state.velocity[k, i] += correction[n + h + i]


@kernel
def add_information(information, fraction, free, n_pose, covariance):
    """Replace the covariances of pose and shape by ``(P^-1 + fraction I)^-1``.

    Args:
        information: shape (frame, pose + shape, pose + shape).
        fraction: fraction of the information that is added.
        free: shape (frame,), int64: 0 where the shape is fixed and has no variance.
        n_pose: number of pose numbers.
        covariance: shape (frame, pose + shape + pose, the same), in and out.

    Returns:
        Number of completed frames; fewer than all if rounding made a covariance indefinite.
    """
    size = information.shape[1]
    inverse, scratch = np.empty((size, size)), np.empty(2 * size)
    for k in range(free.shape[0]):
        m = size if free[k] != 0 else n_pose
        for i in range(m):
            for j in range(i + 1):
                inverse[i, j] = covariance[k, i, j]
        if not invert(inverse, m, scratch):
            return k
        for i in range(m):
            for j in range(i + 1):
                inverse[i, j] += fraction * information[k, i, j]
        if not invert(inverse, m, scratch):
            return k
        for i in range(m):
            for j in range(m):
                covariance[k, i, j] = inverse[i, j]
    return free.shape[0]
