"""Parts of bodies told where the body has them, as observations of their root.

States are those of :mod:`posefuse.kernels.tracking.articulated`. Positions and turns are told one after the other; each is an
exact update of a Kalman filter, applied as a change of the state.
"""

import math

from posefuse.kernels.cameras.points import invert_symmetric
from posefuse.kernels.jit import kernel, step
from posefuse.kernels.linear_algebra.rotations import turn_between
from posefuse.kernels.tracking.bodies import move


@step
def _learn(cov, first, off, noise, gain, change):
    """Tell three numbers of a state, from ``first`` on, by how much they are off, with noise xx xy xz yy yz zz.

    The covariance is put right in place; ``change`` is that of the whole state, ``gain`` is room, shape (3, all).
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
        change[i] = gain[0, i] * off[0] + gain[1, i] * off[1] + gain[2, i] * off[2]
    for i in range(size):
        gain[3, i], gain[4, i], gain[5, i] = cov[a, i], cov[b, i], cov[c, i]
    for i in range(size):
        for j in range(size):
            cov[i, j] -= gain[0, i] * gain[3, j] + gain[1, i] * gain[4, j] + gain[2, i] * gain[5, j]


@step
def _apply(change, state, p):
    """Change one person's state."""
    n, h = state.velocity.shape[1], state.shape.shape[1]
    move(change, state.root[p], state.turns[p], state.bones[p])
    for i in range(h):
        state.shape[p, i] += change[n + i]
    for i in range(n):
        state.velocity[p, i] += change[n + h + i]


@kernel
def tell_anchors(places, place_noise, turns, turn_noise, gain, change, state):
    """Tell parts where their roots are, and how they are turned.

    Args:
        places: shape (person, 3): of the root, m; NaN where nothing is known.
        place_noise: shape (person, 6): xx xy xz yy yz zz, m^2.
        turns: shape (person, 3, 3): of the first segment; NaN where nothing is known.
        turn_noise: shape (person, 6): in the segment's axes, radians^2.
        gain: shape (6, pose + shape + pose): room.
        change: shape (pose + shape + pose,): room.
        state: a State of the parts, in and out.
    """
    off = change[:3].copy()
    for p in range(state.root.shape[0]):
        if math.isfinite(places[p, 0]):
            for i in range(3):
                off[i] = places[p, i] - state.root[p, i]
            _learn(state.covariance[p], 0, off, place_noise[p], gain, change)
            _apply(change, state, p)
        if math.isfinite(turns[p, 0, 0]):
            off[0], off[1], off[2] = turn_between(state.turns[p, 0], turns[p])
            _learn(state.covariance[p], 3, off, turn_noise[p], gain, change)
            _apply(change, state, p)
