"""Refiltering of one person with discounted information, using only the states of the first filter pass.

States are those of :mod:`posefuse.kernels.tracking.records`, of one person, with frames on the person axis. The steps
of each frame are explained in :mod:`posefuse.tracking.tempering`.
"""

from collections import namedtuple

import numpy as np

from posefuse.kernels.jit import kernel, subroutine, vectorized
from posefuse.kernels.linear_algebra.rotations import rotate
from posefuse.kernels.linear_algebra.symmetric import invert
from posefuse.kernels.tracking.body_kinematics import apply_increment
from posefuse.kernels.tracking.predict import (
    PredictedState,
    add_process_noise,
    limit_triangle_variances,
    limit_variances,
    predict_covariance,
    predict_state,
    propagate_covariance,
    velocity_decay,
)
from posefuse.kernels.tracking.smoothing import state_difference, tilt_between
from posefuse.kernels.tracking.update import copy_rotations, copy_triangle, update_velocities

_Workspace = namedtuple(
    "_Workspace",
    "decay reach change force row predicted_information frame_information prior_information posterior_information gain "
    "cross rotation tilted",
)
"""Scratch arrays: velocity decay and reach over a frame; the difference of two states; the force of a frame; a row; the
prior information of the first filter and the information its frame added; the prior and posterior information of this
filter; the velocity gain; the cosine and sine between bone frames; and one tilted bone frame.
"""


ROUNDING_TOLERANCE = 1e-6
"""Fraction of the prior information by which rounding may make the information of a frame negative."""


@kernel
def refilter(dt_s, motion, filtered, fraction, discount, state, information):
    """Filter frames again in which the shape is estimated throughout, or fixed throughout.

    Args:
        dt_s: shape (frame,): time since the previous frame; the first entry is not used.
        motion: a MotionModel.
        filtered: a State with frames: result of the first filter.
        fraction: shape (frame,): fraction of the information that the first filter used which is used now.
        discount: shape (frame,): factor by which the first filter discounted the nominal information of each frame.
        state: a State with frames: the first is given, the others are written; ``free`` stays unchanged.
        information: shape (frame, pose + shape, pose + shape): nominal information of the frames, in the axes of
            ``state``; written from the second frame on.

    Returns:
        Number of completed frames; fewer than all if rounding made a covariance indefinite, or if the first filter lost
        information in a frame.
    """
    frames, n = filtered.velocity.shape
    h = filtered.shape.shape[1]
    m = n + h if filtered.free[0] != 0 else n
    n_bones = filtered.bones.shape[1]
    workspace = _Workspace(
        decay=np.empty(n), reach=np.empty(n), change=np.empty(2 * n + h), force=np.empty(n + h),
        row=np.empty(2 * (n + h)), predicted_information=np.empty((n + h, n + h)),
        frame_information=np.empty((n + h, n + h)), prior_information=np.empty((n + h, n + h)),
        posterior_information=np.empty((n + h, n + h)),
        gain=np.empty((n, n + h)), cross=np.empty((n, n + h)), rotation=np.empty((n_bones, 2)),
        tilted=np.empty((3, 3)),
    )  # fmt: skip
    predicted = PredictedState(
        np.empty((1, 3)), np.empty((1, filtered.turns.shape[1], 3, 3)), np.empty((1, n_bones, 3, 3)),
        np.empty((1, h)), np.empty((1, n)),
    )  # fmt: skip
    for k in range(1, frames):
        velocity_decay(dt_s[k], motion.decay_s, workspace.decay, workspace.reach)
        _predict_frame(state, k, dt_s[k], motion, motion.walk if m > n else 0.0, workspace)
        predict_state(filtered, k - 1, workspace.decay, workspace.reach, workspace.change, predicted)
        state_difference(predicted, 0, filtered, k, workspace.change)
        predict_covariance(
            filtered.covariance[k - 1],
            dt_s[k],
            motion,
            workspace.decay,
            workspace.reach,
            m,
            m,
            workspace.predicted_information,
        )
        limit_triangle_variances(workspace.predicted_information, motion.max_variance, m)
        copy_triangle(filtered.covariance[k], m, workspace.frame_information)
        copy_triangle(state.covariance[k], m, workspace.prior_information)
        # A single loop covers all inversions, so that its body is compiled once.
        for i in range(4):
            if i == 3:
                _extract_information(
                    workspace.frame_information, workspace.predicted_information, workspace.change, m, workspace.force
                )
                if _loses_information(workspace.frame_information, workspace.predicted_information, m):
                    return k
                _add_frame(state, filtered, k, fraction[k], n, m, workspace)
            matrix = (
                workspace.predicted_information
                if i == 0
                else workspace.frame_information
                if i == 1
                else workspace.prior_information
                if i == 2
                else workspace.posterior_information
            )
            if not invert(matrix, m, workspace.row):
                return k
        _update_frame(state, k, n, m, workspace)
        _align_bones(state, filtered, k, workspace)
        _rotate_information(
            workspace.frame_information, m, n, discount[k], workspace.rotation, workspace.posterior_information
        )
        for i in range(n + h):
            for j in range(n + h):
                information[k, i, j] = workspace.posterior_information[i, j] if i < m and j < m else 0.0
    return frames


@vectorized
def _extract_information(frame_information, prior_information, change, m, force):
    """Compute ``frame_information -= prior_information`` and ``force = prior_information change``."""
    for i in range(m):
        total = 0.0
        for j in range(m):
            frame_information[i, j] -= prior_information[i, j]
            total += prior_information[i, j] * change[j]
        force[i] = total


@subroutine
def _loses_information(frame_information, prior_information, m):
    """Return whether a frame reduces the information of any number by more than rounding."""
    least = 0.0
    for i in range(m):
        least = min(least, frame_information[i, i] + ROUNDING_TOLERANCE * prior_information[i, i])
    return least < 0.0


@subroutine
def _predict_frame(state, k, dt, motion, walk, workspace):
    """Predict frame ``k`` from the previous one."""
    n = workspace.decay.shape[0]
    for i in range(n):
        workspace.change[i] = workspace.reach[i] * state.velocity[k - 1, i]
        state.velocity[k, i] = workspace.decay[i] * state.velocity[k - 1, i]
    for i in range(3):
        state.root[k, i] = state.root[k - 1, i]
    for i in range(state.shape.shape[1]):
        state.shape[k, i] = state.shape[k - 1, i]
    copy_rotations(state.turns[k - 1], state.turns[k])
    copy_rotations(state.bones[k - 1], state.bones[k])
    apply_increment(workspace.change, state.root[k], state.turns[k], state.bones[k])
    predicted_information, now = state.covariance[k - 1], state.covariance[k]
    for i in range(now.shape[0]):
        for j in range(now.shape[0]):
            now[i, j] = predicted_information[i, j]
    propagate_covariance(now, workspace.decay, workspace.reach)
    add_process_noise(now, dt, motion, workspace.decay, walk)
    limit_variances(now, motion.max_variance)


@subroutine
def _align_bones(state, filtered, k, workspace):
    """Write, per bone, cosine and sine from its frame in ``state``, tilted to that in ``filtered``, to the latter."""
    for b in range(state.bones.shape[1]):
        own, other, tilted = state.bones[k, b], filtered.bones[k, b], workspace.tilted
        for i in range(3):
            for j in range(3):
                tilted[i, j] = own[i, j]
        x, y = tilt_between(own, other)
        rotate(tilted, x, y, 0.0)
        workspace.rotation[b, 0] = other[0, 0] * tilted[0, 0] + other[1, 0] * tilted[1, 0] + other[2, 0] * tilted[2, 0]
        workspace.rotation[b, 1] = other[0, 1] * tilted[0, 0] + other[1, 1] * tilted[1, 0] + other[2, 1] * tilted[2, 0]


@subroutine
def _rotate_information(frame_information, m, n, factor, rotation, out):
    """Write ``factor T^T frame_information T`` with the bone rotations ``T`` in the last columns of the pose."""
    first = n - 2 * rotation.shape[0]
    for i in range(m):
        for j in range(m):
            out[i, j] = factor * frame_information[i, j]
    for b in range(rotation.shape[0]):
        c, s, x = rotation[b, 0], rotation[b, 1], first + 2 * b
        for j in range(m):
            one, other = out[x, j], out[x + 1, j]
            out[x, j] = c * one + s * other
            out[x + 1, j] = c * other - s * one
        for i in range(m):
            one, other = out[i, x], out[i, x + 1]
            out[i, x] = c * one + s * other
            out[i, x + 1] = c * other - s * one


@subroutine
def _rotate_force(force, n, rotation):
    """Compute ``T^T force`` in place."""
    first = n - 2 * rotation.shape[0]
    for b in range(rotation.shape[0]):
        c, s, x = rotation[b, 0], rotation[b, 1], first + 2 * b
        one, other = force[x], force[x + 1]
        force[x] = c * one + s * other
        force[x + 1] = c * other - s * one


@vectorized
def _combine(prior_information, posterior_information, change, fraction, m, force):
    """Compute ``force = fraction force + posterior change`` and add the prior to the posterior, lower triangle."""
    for i in range(m):
        total = fraction * force[i]
        for j in range(m):
            total += posterior_information[i, j] * change[j]
        force[i] = total
    for i in range(m):
        for j in range(i + 1):
            posterior_information[i, j] += prior_information[i, j]


@vectorized
def _product(matrix, vector, m, out):
    """Multiply a matrix and a vector."""
    for i in range(m):
        total = 0.0
        for j in range(m):
            total += matrix[i, j] * vector[j]
        out[i] = total


@subroutine
def _add_frame(state, filtered, k, fraction, n, m, workspace):
    """Add a fraction of the information of frame ``k`` to the prior; write the posterior information and its force."""
    _align_bones(state, filtered, k, workspace)
    state_difference(state, k, filtered, k, workspace.change)
    _rotate_information(
        workspace.frame_information, m, n, fraction, workspace.rotation, workspace.posterior_information
    )
    _rotate_force(workspace.force, n, workspace.rotation)
    _combine(
        workspace.prior_information, workspace.posterior_information, workspace.change, fraction, m, workspace.force
    )


@subroutine
def _update_frame(state, k, n, m, workspace):
    """Update frame ``k`` with the posterior."""
    _product(workspace.posterior_information, workspace.force, m, workspace.change)
    update_velocities(
        state.covariance[k],
        workspace.prior_information,
        workspace.posterior_information,
        workspace.change,
        m,
        state.velocity[k],
        workspace.gain,
        workspace.cross,
    )
    apply_increment(workspace.change, state.root[k], state.turns[k], state.bones[k])
    for i in range(m - n):
        state.shape[k, i] += workspace.change[n + i]
