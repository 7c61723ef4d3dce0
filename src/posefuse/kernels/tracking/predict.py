"""One person's state a frame later, before anything of that frame is seen; as ``predict_people`` has it."""

import math
from collections import namedtuple

from posefuse.kernels.jit import inline, step
from posefuse.kernels.tracking.bodies import move

Foretold = namedtuple("Foretold", "root turns bones shape velocity")
"""A State of :mod:`posefuse.kernels.tracking.articulated` without its covariance, of one frame."""


@inline
def fade_over(dt, decay_s, fade, reach):
    """By how much velocities fade, and how far they carry meanwhile; shape (pose,), written."""
    for i in range(decay_s.shape[0]):
        fade[i] = math.exp(-dt / decay_s[i])
        reach[i] = decay_s[i] * (1.0 - fade[i])


@step
def foretell(states, k, fade, reach, change, out):
    """The state after frame ``k``, without its covariance, into the only frame of ``out``."""
    n = fade.shape[0]
    for i in range(n):
        change[i] = reach[i] * states.velocity[k, i]
        out.velocity[0, i] = fade[i] * states.velocity[k, i]
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
    move(change, out.root[0], out.turns[0], out.bones[0])


@step
def covariance_ahead(cov, dt, decay_s, power, fade, reach, walk, m, rows, out):
    """A covariance a frame later, unclipped: its lower triangle.

    Args:
        cov: shape (all, all).
        dt: until then, s.
        decay_s: shape (pose,): in what time velocities fade.
        power: shape (pose,): spectral density of the accelerations.
        fade: shape (pose,), from :func:`fade_over`.
        reach: shape (pose,), likewise.
        walk: variance by which each number of a shape wanders, m^2 / s.
        m: numbers of the pose, and of the shape where it is sought.
        rows: of the result: ``m``, or ``m`` and as many as velocities.
        out: shape (at least rows, at least rows), written.
    """
    n = fade.shape[0]
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
            out[m + i, j] = fade[i] * value
        for j in range(i + 1):
            out[m + i, m + j] = fade[i] * fade[j] * cov[first + i, first + j]
    for i in range(m):
        out[i, i] += growth(dt, decay_s[i], power[i], fade[i])[0] if i < n else walk * dt
    for i in range(rows - m):
        _, mixed, fast = growth(dt, decay_s[i], power[i], fade[i])
        out[m + i, i] += mixed
        out[m + i, m + i] += fast


@inline
def growth(dt, decay, power, fade):
    """What accelerations add to the variance of a number, to its covariance with its velocity, and to that's."""
    place = power * decay * decay * (dt - 2.0 * decay * (1.0 - fade) + 0.5 * decay * (1.0 - fade * fade))
    mixed = 0.5 * power * decay * decay * (1.0 - fade) * (1.0 - fade)
    return place, mixed, 0.5 * power * decay * (1.0 - fade * fade)


@step
def clip_triangle(triangle, most, m):
    """No number of a pose is less known than that; of the lower triangle of a covariance of ``m`` rows."""
    for i in range(most.shape[0]):
        if triangle[i, i] > most[i]:
            scale = math.sqrt(most[i] / triangle[i, i])
            for j in range(i + 1):
                triangle[i, j] *= scale
            for j in range(i, m):
                triangle[j, i] *= scale
