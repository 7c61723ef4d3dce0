"""One person filtered again with less said by each frame, from the states of the first filter alone.

States are those of :mod:`posefuse.kernels.tracking.articulated`, of one person, with frames where people stand there. What is
done in each frame, and why, is said in :mod:`posefuse.tracking.tempering`.
"""

from collections import namedtuple

import numpy as np

from posefuse.kernels.jit import dense, kernel, step
from posefuse.kernels.linear_algebra.rotations import turn
from posefuse.kernels.linear_algebra.symmetric import invert
from posefuse.kernels.tracking.articulated import carry_on, clip, copy_frames, copy_triangle, grow, spread_to_velocities
from posefuse.kernels.tracking.bodies import move
from posefuse.kernels.tracking.predict import Foretold, clip_triangle, covariance_ahead, fade_over, foretell
from posefuse.kernels.tracking.smoothing import difference, tilt_between

_Room = namedtuple("_Room", "fade reach change pull row before said known after gain mixed rotation carried")
"""How velocities act over a frame; how two states differ; what a frame pulls; a row; what the first filter knew
before it, what it said, what is known before it now and after; how velocities follow; how bones' frames lie to each
other, cosines and sines; and one of them."""


ROUNDING = 1e-6
"""By which share of what was known before a frame rounding may make what it says negative."""


@kernel
def filter_again(dt_s, decay_s, power, most, walk, filtered, share, told, state, information):
    """Filter frames again in which the shape is sought all along, or kept all along.

    Args:
        dt_s: shape (frame,): since the frame before; the first does not count.
        decay_s: shape (pose,): in what time velocities fade.
        power: shape (pose,): spectral density of the accelerations, units^2 / s^3.
        most: shape (pose,): the largest variance of each number.
        walk: variance by which each number of a shape wanders, m^2 / s.
        filtered: a State with frames: what the first filter found.
        share: shape (frame,): which of what the first filter was told is told now.
        told: shape (frame,): by how much the first filter was told less than frames say at face value.
        state: a State with frames: the first is known, the others are written; ``free`` is left as it is.
        information: shape (frame, pose + shape, pose + shape): what frames say at face value, in the axes of
            ``state``; written from the second on.

    Returns:
        How many frames are done: fewer than all where rounding left a covariance that is none, or the first filter knew
        less after a frame than before it.
    """
    frames, n = filtered.velocity.shape
    h = filtered.shape.shape[1]
    m = n + h if filtered.free[0] != 0 else n
    n_bones = filtered.bones.shape[1]
    room = _Room(
        fade=np.empty(n), reach=np.empty(n), change=np.empty(2 * n + h), pull=np.empty(n + h), row=np.empty(n + h),
        before=np.empty((n + h, n + h)), said=np.empty((n + h, n + h)), known=np.empty((n + h, n + h)),
        after=np.empty((n + h, n + h)),
        gain=np.empty((n, n + h)), mixed=np.empty((n, n + h)), rotation=np.empty((n_bones, 2)),
        carried=np.empty((3, 3)),
    )  # fmt: skip
    foretold = Foretold(
        np.empty((1, 3)), np.empty((1, filtered.turns.shape[1], 3, 3)), np.empty((1, n_bones, 3, 3)),
        np.empty((1, h)), np.empty((1, n)),
    )  # fmt: skip
    for k in range(1, frames):
        fade_over(dt_s[k], decay_s, room.fade, room.reach)
        sought = walk if m > n else 0.0
        _move_on(state, k, dt_s[k], decay_s, power, most, sought, room)
        foretell(filtered, k - 1, room.fade, room.reach, room.change, foretold)
        difference(foretold, 0, filtered, k, room.change)
        covariance_ahead(
            filtered.covariance[k - 1], dt_s[k], decay_s, power, room.fade, room.reach, sought, m, m, room.before
        )
        clip_triangle(room.before, most, m)
        copy_triangle(filtered.covariance[k], m, room.said)
        copy_triangle(state.covariance[k], m, room.known)
        # One loop for all, so that its body is compiled once.
        for i in range(4):
            if i == 3:
                _subtract(room.said, room.before, room.change, m, room.pull)
                if _forgets(room.said, room.before, m):
                    return k
                _hear(state, filtered, k, share[k], n, m, room)
            matrix = room.before if i == 0 else room.said if i == 1 else room.known if i == 2 else room.after
            if not invert(matrix, m, room.row):
                return k
        _learn(state, k, n, m, room)
        _lie_of_bones(state, filtered, k, room)
        _turned(room.said, m, n, told[k], room.rotation, room.after)
        for i in range(n + h):
            for j in range(n + h):
                information[k, i, j] = room.after[i, j] if i < m and j < m else 0.0
    return frames


@dense
def _subtract(said, known, change, m, pull):
    """``said -= known`` and ``pull = known change``."""
    for i in range(m):
        total = 0.0
        for j in range(m):
            said[i, j] -= known[i, j]
            total += known[i, j] * change[j]
        pull[i] = total


@step
def _forgets(said, known, m):
    """Whether a frame says less than nothing of a number, by more than rounding."""
    least = 0.0
    for i in range(m):
        least = min(least, said[i, i] + ROUNDING * known[i, i])
    return least < 0.0


@step
def _move_on(state, k, dt, decay_s, power, most, walk, room):
    """Frame ``k`` as foretold from the one before."""
    n = room.fade.shape[0]
    for i in range(n):
        room.change[i] = room.reach[i] * state.velocity[k - 1, i]
        state.velocity[k, i] = room.fade[i] * state.velocity[k - 1, i]
    for i in range(3):
        state.root[k, i] = state.root[k - 1, i]
    for i in range(state.shape.shape[1]):
        state.shape[k, i] = state.shape[k - 1, i]
    copy_frames(state.turns[k - 1], state.turns[k])
    copy_frames(state.bones[k - 1], state.bones[k])
    move(room.change, state.root[k], state.turns[k], state.bones[k])
    before, now = state.covariance[k - 1], state.covariance[k]
    for i in range(now.shape[0]):
        for j in range(now.shape[0]):
            now[i, j] = before[i, j]
    carry_on(now, room.fade, room.reach)
    grow(now, dt, decay_s, power, room.fade, walk)
    clip(now, most)


@step
def _lie_of_bones(state, seen, k, room):
    """Of each bone, how its frame in ``seen`` lies to that in ``state`` once this is tilted there: cosine, sine."""
    for b in range(state.bones.shape[1]):
        own, other, carried = state.bones[k, b], seen.bones[k, b], room.carried
        for i in range(3):
            for j in range(3):
                carried[i, j] = own[i, j]
        x, y = tilt_between(own, other)
        turn(carried, x, y, 0.0)
        room.rotation[b, 0] = other[0, 0] * carried[0, 0] + other[1, 0] * carried[1, 0] + other[2, 0] * carried[2, 0]
        room.rotation[b, 1] = other[0, 1] * carried[0, 0] + other[1, 1] * carried[1, 0] + other[2, 1] * carried[2, 0]


@step
def _turned(said, m, n, factor, rotation, out):
    """``factor T^T said T`` with the rotations of bones in ``T``, whose columns are the last of the pose."""
    first = n - 2 * rotation.shape[0]
    for i in range(m):
        for j in range(m):
            out[i, j] = factor * said[i, j]
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


@step
def _turn_pull(pull, n, rotation):
    """``T^T pull`` in place."""
    first = n - 2 * rotation.shape[0]
    for b in range(rotation.shape[0]):
        c, s, x = rotation[b, 0], rotation[b, 1], first + 2 * b
        one, other = pull[x], pull[x + 1]
        pull[x] = c * one + s * other
        pull[x + 1] = c * other - s * one


@dense
def _add_said(known, after, change, share, m, pull):
    """``pull = share pull + after change`` and ``after += known``, its lower triangle."""
    for i in range(m):
        total = share * pull[i]
        for j in range(m):
            total += after[i, j] * change[j]
        pull[i] = total
    for i in range(m):
        for j in range(i + 1):
            after[i, j] += known[i, j]


@dense
def _product(matrix, vector, m, out):
    for i in range(m):
        total = 0.0
        for j in range(m):
            total += matrix[i, j] * vector[j]
        out[i] = total


@step
def _hear(state, filtered, k, share, n, m, room):
    """What a share of what frame ``k`` said makes of what was known: the information after it, and where it pulls."""
    _lie_of_bones(state, filtered, k, room)
    difference(state, k, filtered, k, room.change)
    _turned(room.said, m, n, share, room.rotation, room.after)
    _turn_pull(room.pull, n, room.rotation)
    _add_said(room.known, room.after, room.change, share, m, room.pull)


@step
def _learn(state, k, n, m, room):
    """Put frame ``k`` right by that."""
    _product(room.after, room.pull, m, room.change)
    spread_to_velocities(
        state.covariance[k], room.known, room.after, room.change, n, m, state.velocity[k], room.gain, room.mixed
    )
    move(room.change, state.root[k], state.turns[k], state.bones[k])
    for i in range(m - n):
        state.shape[k, i] += room.change[n + i]
