"""Motion model of the specification: a root that moves by a twist in SE(3), and velocities that persist.

Source: the specification of the articulated tracker: T <- T exp(dt xi), q <- q + dt dq/dt; see
docs/methods/specification.md. A state holds the root's velocity in world axes; the twist is that velocity in the axes
of the root's segment, with the segment's angular velocity.
"""

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.model.rotations import rotations_from_vectors
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.track_set import advance_state

_DIFFERENCE = 1e-6
"""Step of central differences, in radians."""
_SMALL_ANGLE = 1e-8


class TwistMotion:
    """Constant twist of the root and persistent velocities, each of which can be switched off."""

    def advance(self, state: State, dt_s: float, settings: TrackerSettings) -> None:
        """Predict states by a time, in place; a negative time counts as zero."""
        options = settings.options.specification
        if not (options.twist_motion or options.persistent_velocities):
            advance_state(state, dt_s, settings)
            return
        dt = max(dt_s, 0.0)
        decay, reach, noise = motion_over(dt, settings)
        twist = options.twist_motion and len(settings.tree.segments) > 0
        for p in range(len(state.root)):
            transition = _advance_body(state, p, decay, reach, twist)
            _advance_covariance(state, p, transition, noise, dt, settings)


def motion_over(dt_s: float, settings: TrackerSettings) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...]]:
    """Return the factor of velocities over a time, the time for which they act, and the process noise.

    Args:
        dt_s: The time, in seconds.
        settings: Settings of the tracker.

    Returns:
        Factors, shape (pose,); times, shape (pose,), in seconds; and variances of the pose, covariances with the
        velocity and variances of the velocity, shape (pose,) each.
    """
    power, fade_s = settings.power, settings.decay_s
    if settings.options.specification.persistent_velocities:
        noise = (power * dt_s**3 / 3.0, power * dt_s**2 / 2.0, power * dt_s)
        return np.ones(len(power)), np.full(len(power), dt_s), noise
    decay = np.exp(-dt_s / fade_s)
    position = power * fade_s**2 * (dt_s - 2.0 * fade_s * (1.0 - decay) + 0.5 * fade_s * (1.0 - decay**2))
    cross = 0.5 * power * fade_s**2 * (1.0 - decay) ** 2
    return decay, fade_s * (1.0 - decay), (position, cross, 0.5 * power * fade_s * (1.0 - decay**2))


def _advance_body(state: State, p: int, decay: np.ndarray, reach: np.ndarray, twist: bool) -> np.ndarray:
    """Move one body by its velocities, in place; return the transition matrix, shape (all, all)."""
    n, velocity = state.velocity.shape[1], state.velocity[p].copy()
    size, segments = state.covariance.shape[1], state.turns.shape[1]
    transition = np.eye(size)
    first = size - n
    transition[np.arange(n), first + np.arange(n)] = reach
    transition[first + np.arange(n), first + np.arange(n)] = decay
    change = reach * velocity
    state.velocity[p] = decay * velocity
    if twist:
        pose, speed, block = advance_root(state.turns[p, 0], velocity[:6], decay[:6], reach[:6])
        state.root[p] += pose
        state.velocity[p, :3] = speed
        columns = np.r_[0:6, first : first + 6]
        transition[np.ix_(columns, columns)] = block
    else:
        state.root[p] += change[:3]
    turns = rotations_from_vectors(change[3 : 3 + 3 * segments].reshape(-1, 3))
    state.turns[p] = state.turns[p] @ turns
    bends = np.zeros((state.bones.shape[1], 3))
    bends[:, :2] = change[3 + 3 * segments :].reshape(-1, 2)
    state.bones[p] = state.bones[p] @ rotations_from_vectors(bends)
    return transition


def advance_root(
    turn: np.ndarray, velocity: np.ndarray, decay: np.ndarray, reach: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return displacement and velocity of a root that moves by a twist, and their derivatives.

    Args:
        turn: shape (3, 3): world from segment.
        velocity: shape (6,): velocity in world axes, angular velocity in the segment's axes.
        decay: shape (6,): factors of the velocities.
        reach: shape (6,): times for which they act, equal for each of the two, in seconds.

    Returns:
        Displacement and velocity in world axes, shape (3,) each; and the derivative of position, turn, velocity and
        angular velocity by the same before, shape (12, 12), with turns as increments in the segment's axes.
    """
    own, angle = turn.T @ velocity[:3], reach[3] * velocity[3:]
    rotation, spread = rotations_from_vectors(angle), left_jacobian(angle)
    path, turned = reach[0] * spread @ own, rotation @ own
    right = left_jacobian(-angle)
    bent = np.empty((3, 3))
    for i, step in enumerate(_DIFFERENCE * np.eye(3)):
        bent[:, i] = (left_jacobian(angle + step) - left_jacobian(angle - step)) @ own / (2.0 * _DIFFERENCE)
    block = np.zeros((12, 12))
    block[:3, :3] = np.eye(3)
    block[:3, 3:6] = turn @ (reach[0] * spread @ cross_matrix(own) - cross_matrix(path))
    block[:3, 6:9] = reach[0] * turn @ spread @ turn.T
    block[:3, 9:] = reach[0] * reach[3] * turn @ bent
    block[3:6, 3:6] = rotation.T
    block[3:6, 9:] = reach[3] * right
    block[6:9, 3:6] = decay[0] * turn @ (rotation @ cross_matrix(own) - cross_matrix(turned))
    block[6:9, 6:9] = decay[0] * turn @ rotation @ turn.T
    block[6:9, 9:] = -decay[0] * reach[3] * turn @ rotation @ cross_matrix(own) @ right
    block[9:, 9:] = np.diag(decay[3:6])
    return turn @ path, decay[0] * turn @ turned, block


def left_jacobian(angle: np.ndarray) -> np.ndarray:
    """Return V of exp([angle, path]) = (rotation, V path) in SE(3): the left Jacobian of a rotation vector."""
    size = float(np.linalg.norm(angle))
    across = cross_matrix(angle)
    if size < _SMALL_ANGLE:
        return np.eye(3) + 0.5 * across
    return (
        np.eye(3)
        + (1.0 - np.cos(size)) / size**2 * across
        + (size - np.sin(size)) / size**3 * across @ across
    )  # fmt: skip


def cross_matrix(vector: np.ndarray) -> np.ndarray:
    """Return the matrix of the cross product with a vector, shape (3, 3)."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _advance_covariance(
    state: State,
    p: int,
    transition: np.ndarray,
    noise: tuple[np.ndarray, ...],
    dt_s: float,
    settings: TrackerSettings,
) -> None:
    """Propagate the covariance of one body, add process noise and limit variances, in place."""
    n, h = state.velocity.shape[1], state.shape.shape[1]
    covariance = transition @ state.covariance[p] @ transition.T
    i, v, s = np.arange(n), n + h + np.arange(n), n + np.arange(h)
    position, between, speed = noise
    covariance[i, i] += position
    covariance[i, v] += between
    covariance[v, i] += between
    covariance[v, v] += speed
    if state.free[p]:
        covariance[s, s] += settings.motion.walk * dt_s
    shrink = np.ones(len(covariance))
    shrink[:n] = np.sqrt(np.minimum(1.0, settings.most / covariance[i, i]))
    state.covariance[p] = 0.5 * (covariance + covariance.T) * shrink[:, None] * shrink
