"""What later frames say of bodies in earlier ones: the means of a Rauch-Tung-Striebel smoother.

States are those of :mod:`posefuse.kernels.articulated`, of one person, with frames where people stand there.
"""

import math

from posefuse.kernels.bodies import move
from posefuse.kernels.jit import kernel, step
from posefuse.kernels.rotations import turn_between


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
def carry_back(gains, rows, predicted, state, late, correction):
    """Correct the means of frames by what came after, last frame first.

    Args:
        gains: shape (frame, row, row): of the smoother, from each frame's successor.
        rows: shape (row,), int64: which numbers of (pose, shape, velocity) the gains are of; others stay.
        predicted: a State: what each frame foretold of its successor.
        state: a State, filtered, in; smoothed, out: one frame more than the gains; the last is smoothed already.
        late: shape (pose + shape + pose,): room.
        correction: shape (pose + shape + pose,): room.
    """
    n, h = state.velocity.shape[1], state.shape.shape[1]
    for k in range(gains.shape[0] - 1, -1, -1):
        difference(predicted, k, state, k + 1, late)
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
