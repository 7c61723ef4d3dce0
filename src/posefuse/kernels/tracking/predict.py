"""Prediction of articulated bodies: Ornstein-Uhlenbeck velocities, for all people and for one person over one frame."""

import math
from collections import namedtuple

import numpy as np

from posefuse.kernels.jit import inline, kernel, subroutine
from posefuse.kernels.tracking.body_kinematics import apply_increment

PredictedState = namedtuple("PredictedState", "root turns bones shape velocity")
"""A State of one frame without covariance."""


@inline
def velocity_decay(dt, decay_s, decay, reach):
    """Write the decay factors of velocities and the times over which they act, shape (pose,)."""
    for i in range(decay_s.shape[0]):
        decay[i] = math.exp(-dt / decay_s[i])
        reach[i] = decay_s[i] * (1.0 - decay[i])


@subroutine
def predict_state(states, k, decay, reach, change, out):
    """Write the state predicted from frame ``k``, without its covariance, to the only frame of ``out``."""
    n = decay.shape[0]
    for i in range(n):
        change[i] = reach[i] * states.velocity[k, i]
        out.velocity[0, i] = decay[i] * states.velocity[k, i]
    for i in range(3):
        out.root[0, i] = states.root[k, i]
    for i in range(states.shape.shape[1]):
        out.shape[0, i] = states.shape[k, i]
    for i in range(3):
        for j in range(3):
            for s in range(states.turns.shape[1]):
                out.turns[0, s, i, j] = states.turns[k, s, i, j]
            for b in range(states.bones.shape[1]):
                out.bones[0, b, i, j] = states.bones[k, b, i, j]
    apply_increment(change, out.root[0], out.turns[0], out.bones[0])


@subroutine
def predict_covariance(cov, dt, motion, decay, reach, m, rows, out):
    """Write the lower triangle of a covariance predicted over one frame, without the limit on variances.

    Args:
        cov: shape (all, all).
        dt: time to the next frame, s.
        motion: a MotionModel.
        decay: shape (pose,), from :func:`velocity_decay`.
        reach: shape (pose,), likewise.
        m: number of pose numbers, plus shape numbers if the shape is estimated.
        rows: of the result: ``m``, or ``m`` plus the number of velocities.
        out: shape (at least rows, at least rows), written.
    """
    decay_s, power = motion.decay_s, motion.power
    n = decay.shape[0]
    first = cov.shape[0] - n
    for i in range(m):
        for j in range(i + 1):
            value = cov[i, j]
            if j < n:
                value += reach[j] * cov[first + j, i]
            if i < n:
                value += reach[i] * cov[first + i, j] + reach[i] * reach[j] * cov[first + i, first + j]
            out[i, j] = value
    for i in range(rows - m):
        for j in range(m):
            value = cov[first + i, j]
            if j < n:
                value += reach[j] * cov[first + i, first + j]
            out[m + i, j] = decay[i] * value
        for j in range(i + 1):
            out[m + i, m + j] = decay[i] * decay[j] * cov[first + i, first + j]
    for i in range(m):
        out[i, i] += process_noise(dt, decay_s[i], power[i], decay[i])[0] if i < n else motion.walk * dt
    for i in range(rows - m):
        _, cross, velocity = process_noise(dt, decay_s[i], power[i], decay[i])
        out[m + i, i] += cross
        out[m + i, m + i] += velocity


@inline
def process_noise(dt, decay_time, power, decay):
    """Return the process noise: variance of a number, its covariance with its velocity, variance of the velocity."""
    position = (
        power
        * decay_time
        * decay_time
        * (dt - 2.0 * decay_time * (1.0 - decay) + 0.5 * decay_time * (1.0 - decay * decay))
    )
    cross = 0.5 * power * decay_time * decay_time * (1.0 - decay) * (1.0 - decay)
    return position, cross, 0.5 * power * decay_time * (1.0 - decay * decay)


@subroutine
def limit_triangle_variances(triangle, max_variance, m):
    """Limit the variances of the pose in the lower triangle of a covariance of ``m`` rows."""
    for i in range(max_variance.shape[0]):
        if triangle[i, i] > max_variance[i]:
            scale = math.sqrt(max_variance[i] / triangle[i, i])
            for j in range(i + 1):
                triangle[i, j] *= scale
            for j in range(i, m):
                triangle[j, i] *= scale


@kernel
def predict_people(dt_s, motion, state):
    """Predict all people to a later time: velocities decay and variances grow.

    Args:
        dt_s: shape (person,).
        motion: a MotionModel.
        state: a State, in and out.
    """
    decay_s = motion.decay_s
    n = state.velocity.shape[1]
    decay = np.empty(n)
    reach = np.empty(n)
    change = np.empty(n)
    for p in range(dt_s.shape[0]):
        for i in range(n):
            decay[i] = math.exp(-dt_s[p] / decay_s[i])
            reach[i] = decay_s[i] * (1.0 - decay[i])
            change[i] = reach[i] * state.velocity[p, i]
            state.velocity[p, i] *= decay[i]
        apply_increment(change, state.root[p], state.turns[p], state.bones[p])
        propagate_covariance(state.covariance[p], decay, reach)
        walk = motion.walk if state.free[p] != 0 else 0.0
        add_process_noise(state.covariance[p], dt_s[p], motion, decay, walk)
        limit_variances(state.covariance[p], motion.max_variance)


@subroutine
def propagate_covariance(cov, decay, reach):
    """Compute ``F P F^T`` in place: each number of the pose moves by its velocity, which decays."""
    n = decay.shape[0]
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
            cov[i, first + j] = (cov[i, first + j] + gain) * decay[j]
            cov[first + j, i] = cov[i, first + j]
    for i in range(n):
        for j in range(n):
            cov[first + i, first + j] *= decay[i] * decay[j]


@subroutine
def add_process_noise(cov, dt, motion, decay, walk):
    """Add the process noise of accelerations, and of the shape's random walk, whose variance ``walk`` may be 0."""
    decay_s, power = motion.decay_s, motion.power
    n = decay.shape[0]
    first = cov.shape[0] - n
    for i in range(n):
        q = power[i]
        t = decay_s[i]
        f = decay[i]
        cov[i, i] += q * t * t * (dt - 2.0 * t * (1.0 - f) + 0.5 * t * (1.0 - f * f))
        cross = 0.5 * q * t * t * (1.0 - f) * (1.0 - f)
        cov[i, first + i] += cross
        cov[first + i, i] += cross
        cov[first + i, first + i] += 0.5 * q * t * (1.0 - f * f)
    for s in range(n, first):
        cov[s, s] += walk * dt


@subroutine
def limit_variances(cov, max_variance):
    """Limit the variances of the pose; rows and columns are scaled alike, so the matrix stays a covariance."""
    for i in range(max_variance.shape[0]):
        if cov[i, i] > max_variance[i]:
            scale = math.sqrt(max_variance[i] / cov[i, i])
            for j in range(cov.shape[0]):
                cov[i, j] *= scale
                cov[j, i] *= scale
