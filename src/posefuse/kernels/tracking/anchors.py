"""Updates of body parts by anchors: the root position and orientation that the whole body gives them.

States are those of :mod:`posefuse.kernels.tracking.records`. Position and orientation are applied one after the other,
each as an exact Kalman update that changes the state.
"""

import math

from posefuse.kernels.jit import kernel, subroutine
from posefuse.kernels.linear_algebra.rotations import rotation_between
from posefuse.kernels.linear_algebra.symmetric_3x3 import invert_symmetric
from posefuse.kernels.tracking.body_kinematics import apply_increment


@subroutine
def _update_three(cov, first, innovation, noise, gain, change):
    """Update the state with a measurement of three consecutive numbers, from ``first`` on.

    ``innovation`` is measured minus predicted, ``noise`` its covariance xx xy xz yy yz zz. The covariance is updated in
    place. ``change`` receives the change of the whole state; ``gain``, shape (6, all), is scratch.
    """
    size = change.shape[0]
    a, b, c = first, first + 1, first + 2
    _, w0, w1, w2, w3, w4, w5 = invert_symmetric(
        cov[a, a] + noise[0], cov[a, b] + noise[1], cov[a, c] + noise[2], cov[b, b] + noise[3], cov[b, c] + noise[4],
        cov[c, c] + noise[5],
    )  # fmt: skip
    for i in range(size):
        x, y, z = cov[i, a], cov[i, b], cov[i, c]
        gain[0, i] = x * w0 + y * w1 + z * w2
        gain[1, i] = x * w1 + y * w3 + z * w4
        gain[2, i] = x * w2 + y * w4 + z * w5
        change[i] = gain[0, i] * innovation[0] + gain[1, i] * innovation[1] + gain[2, i] * innovation[2]
    for i in range(size):
        gain[3, i], gain[4, i], gain[5, i] = cov[a, i], cov[b, i], cov[c, i]
    for i in range(size):
        for j in range(size):
            cov[i, j] -= gain[0, i] * gain[3, j] + gain[1, i] * gain[4, j] + gain[2, i] * gain[5, j]


@subroutine
def _apply_change(change, state, p):
    """Apply a change to the state of one person."""
    n, h = state.velocity.shape[1], state.shape.shape[1]
    apply_increment(change, state.root[p], state.turns[p], state.bones[p])
    for i in range(h):
        state.shape[p, i] += change[n + i]
    for i in range(n):
        state.velocity[p, i] += change[n + h + i]


@kernel
def update_from_anchors(positions, position_noise, rotations, rotation_noise, gain, change, state):
    """Update the root position and the root orientation of body parts.

    Args:
        positions: shape (person, 3): of the root, m; NaN where unknown.
        position_noise: shape (person, 6): xx xy xz yy yz zz, m^2.
        rotations: shape (person, 3, 3): of the first segment; NaN where unknown.
        rotation_noise: shape (person, 6): in the axes of the segment, radians^2.
        gain: shape (6, pose + shape + pose), scratch.
        change: shape (pose + shape + pose,), scratch.
        state: State of the parts, in and out.
    """
    innovation = change[:3].copy()
    for p in range(state.root.shape[0]):
        if math.isfinite(positions[p, 0]):
            for i in range(3):
                innovation[i] = positions[p, i] - state.root[p, i]
            _update_three(state.covariance[p], 0, innovation, position_noise[p], gain, change)
            _apply_change(change, state, p)
        if math.isfinite(rotations[p, 0, 0]):
            innovation[0], innovation[1], innovation[2] = rotation_between(state.turns[p, 0], rotations[p])
            _update_three(state.covariance[p], 3, innovation, rotation_noise[p], gain, change)
            _apply_change(change, state, p)
