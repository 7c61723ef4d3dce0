"""Forward kinematics and Jacobians of an anatomical chain, with the joints and the scaling of OpenSim.

One joint connects every body to its parent. A joint has up to six motions: translations along axes of the parent's
side, then rotations about body-fixed axes, each a function of one coordinate (Seth et al. 2010, Minimal formulation
of joint motion for biomechanisms, Nonlinear Dynamics 62). Scale factors multiply the positions of joints in both of
their bodies, the translations within joints (by the factors of the parent), and the locations of markers, as
OpenSim's ScaleTool does.
"""

from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.jit import kernel, subroutine
from posefuse.kernels.linear_algebra.rotations import exponential

MOTIONS = 6
"""Most motions of a joint: three rotations, then three translations."""


class Chain(NamedTuple):
    """Joints of an anatomical chain; the joint of a body connects it to its parent, which comes before it.

    Attributes:
        parent: shape (body,), int64: index of the parent, -1 for ground.
        parent_offset_m: shape (body, 3): position of the joint in the parent.
        parent_rotation: shape (body, 3, 3): axes of the joint in those of the parent.
        child_offset_m: shape (body, 3): position of the joint in the body.
        child_rotation: shape (body, 3, 3): axes of the joint in those of the body.
        axes: shape (body, MOTIONS, 3): axes of the motions: three rotations, then three translations, with their sign.
        coordinate: shape (body, MOTIONS), int64: coordinate of each motion, -1 if there is none.
        spline: shape (body, MOTIONS), int64: spline of each motion, -1 if the coordinate itself is the motion.
        knots: shape (knot,): arguments at which the pieces of all splines start.
        pieces: shape (spline, knot, 4): cubic polynomials of the distance to the knot, lowest power first.
    """

    parent: Any
    parent_offset_m: Any
    parent_rotation: Any
    child_offset_m: Any
    child_rotation: Any
    axes: Any
    coordinate: Any
    spline: Any
    knots: Any
    pieces: Any


class ChainState(NamedTuple):
    """Bodies of a chain in one frame, and their velocities per unit of each coordinate.

    A coordinate moves the point x of its body and of all bodies beyond with ``linear + angular x (x - center)``.

    Attributes:
        rotations: shape (body, 3, 3): ``world_from_body``.
        origins_m: shape (body, 3).
        centers_m: shape (body, 3): center of the joint of each body, after the translations.
        angular: shape (coordinate, 3).
        linear: shape (coordinate, 3), m per unit.
    """

    rotations: Any
    origins_m: Any
    centers_m: Any
    angular: Any
    linear: Any

    @classmethod
    def allocate(cls, bodies: int, coordinates: int) -> "ChainState":
        """Return arrays for a chain."""
        return cls(
            np.empty((bodies, 3, 3)),
            np.empty((bodies, 3)),
            np.empty((bodies, 3)),
            np.empty((coordinates, 3)),
            np.empty((coordinates, 3)),
        )


@subroutine
def evaluate_spline(knots, pieces, x):
    """Return the value and the derivative of a spline, linear beyond its ends."""
    last = knots.shape[0] - 1
    i = 0
    while i < last and x >= knots[i + 1]:
        i += 1
    d = x - knots[i]
    if d < 0.0 or i == last:
        return pieces[i, 0] + d * pieces[i, 1], pieces[i, 1]
    value = pieces[i, 0] + d * (pieces[i, 1] + d * (pieces[i, 2] + d * pieces[i, 3]))
    return value, pieces[i, 1] + d * (2.0 * pieces[i, 2] + 3.0 * d * pieces[i, 3])


@subroutine
def _motion(chain, body, m, coordinates):
    """Return the value of a motion and its derivative with respect to its coordinate."""
    x = coordinates[chain.coordinate[body, m]]
    s = chain.spline[body, m]
    if s < 0:
        return x, 1.0
    return evaluate_spline(chain.knots, chain.pieces[s], x)


@subroutine
def _multiply(matrix, e):
    """Multiply ``matrix``, shape (3, 3), by the matrix of the nine numbers ``e``, in place."""
    for i in range(3):
        x, y, z = matrix[i, 0], matrix[i, 1], matrix[i, 2]
        matrix[i, 0] = x * e[0] + y * e[3] + z * e[6]
        matrix[i, 1] = x * e[1] + y * e[4] + z * e[7]
        matrix[i, 2] = x * e[2] + y * e[5] + z * e[8]


@subroutine
def _attach_joint(chain, scales, b, state):
    """Set the rotation of a body to the axes of its joint at the parent's side, and the center of the joint."""
    p = chain.parent[b]
    for i in range(3):
        state.centers_m[b, i] = chain.parent_offset_m[b, i]
        for j in range(3):
            state.rotations[b, i, j] = chain.parent_rotation[b, i, j]
    if p >= 0:
        for i in range(3):
            total = state.origins_m[p, i]
            for j in range(3):
                total += state.rotations[p, i, j] * scales[p, j] * chain.parent_offset_m[b, j]
                state.rotations[b, i, j] = (
                    state.rotations[p, i, 0] * chain.parent_rotation[b, 0, j]
                    + state.rotations[p, i, 1] * chain.parent_rotation[b, 1, j]
                    + state.rotations[p, i, 2] * chain.parent_rotation[b, 2, j]
                )
            state.centers_m[b, i] = total


@subroutine
def translation_factor(chain, scales, b, m):
    """Return the factor by which OpenSim scales a translation: linear coordinates keep their unit."""
    p = chain.parent[b]
    if p < 0 or chain.spline[b, m] < 0:
        return 1.0
    return (
        abs(chain.axes[b, m, 0]) * scales[p, 0]
        + abs(chain.axes[b, m, 1]) * scales[p, 1]
        + abs(chain.axes[b, m, 2]) * scales[p, 2]
    )


@subroutine
def _move_joint(chain, scales, coordinates, b, state):
    """Apply the motions of a joint to the rotation of its body and to the center of the joint, and add velocities."""
    rotation = state.rotations[b]
    for m in range(3, MOTIONS):
        c = chain.coordinate[b, m]
        if c >= 0:
            value, slope = _motion(chain, b, m, coordinates)
            factor = translation_factor(chain, scales, b, m)
            axis = chain.axes[b, m]
            for i in range(3):
                direction = factor * (rotation[i, 0] * axis[0] + rotation[i, 1] * axis[1] + rotation[i, 2] * axis[2])
                state.centers_m[b, i] += value * direction
                state.linear[c, i] += slope * direction
    for m in range(3):
        c = chain.coordinate[b, m]
        if c >= 0:
            value, slope = _motion(chain, b, m, coordinates)
            axis = chain.axes[b, m]
            for i in range(3):
                direction = rotation[i, 0] * axis[0] + rotation[i, 1] * axis[1] + rotation[i, 2] * axis[2]
                state.angular[c, i] += slope * direction
            _multiply(rotation, exponential(value * axis[0], value * axis[1], value * axis[2]))


@subroutine
def place_bodies(chain, scales, coordinates, state):
    """Place all bodies.

    Args:
        chain: joints.
        scales: shape (body, 3): scale factors of the bodies.
        coordinates: shape (coordinate,), rad or m.
        state: written.
    """
    state.angular[:] = 0.0
    state.linear[:] = 0.0
    for b in range(chain.parent.shape[0]):
        _attach_joint(chain, scales, b, state)
        _move_joint(chain, scales, coordinates, b, state)
        c = chain.child_rotation[b]
        _multiply(state.rotations[b], (c[0, 0], c[1, 0], c[2, 0], c[0, 1], c[1, 1], c[2, 1], c[0, 2], c[1, 2], c[2, 2]))
        for i in range(3):
            total = state.centers_m[b, i]
            for j in range(3):
                total -= state.rotations[b, i, j] * scales[b, j] * chain.child_offset_m[b, j]
            state.origins_m[b, i] = total


@subroutine
def place_marker(scales, state, body, location_m, position_m):
    """Write the position of a marker at ``location_m``, shape (3,), in the unscaled ``body``."""
    for i in range(3):
        total = state.origins_m[body, i]
        for j in range(3):
            total += state.rotations[body, i, j] * scales[body, j] * location_m[j]
        position_m[i] = total


@subroutine
def coordinate_jacobian(chain, state, body, position_m, jacobian):
    """Write the derivatives of a point of a body with respect to the coordinates, shape (3, coordinate)."""
    jacobian[:] = 0.0
    b = body
    while b >= 0:
        x = position_m[0] - state.centers_m[b, 0]
        y = position_m[1] - state.centers_m[b, 1]
        z = position_m[2] - state.centers_m[b, 2]
        for m in range(MOTIONS):
            c = chain.coordinate[b, m]
            if c >= 0:
                w = state.angular[c]
                jacobian[0, c] = state.linear[c, 0] + w[1] * z - w[2] * y
                jacobian[1, c] = state.linear[c, 1] + w[2] * x - w[0] * z
                jacobian[2, c] = state.linear[c, 2] + w[0] * y - w[1] * x
        b = chain.parent[b]


@subroutine
def scale_jacobian(chain, coordinates, state, body, location_m, jacobian):
    """Write the derivatives of a marker with respect to the scale factors of all bodies, shape (3, body, 3)."""
    jacobian[:] = 0.0
    for i in range(3):
        for j in range(3):
            jacobian[i, body, j] = state.rotations[body, i, j] * location_m[j]
    b = body
    while b >= 0:
        p = chain.parent[b]
        for i in range(3):
            for j in range(3):
                jacobian[i, b, j] -= state.rotations[b, i, j] * chain.child_offset_m[b, j]
                if p >= 0:
                    jacobian[i, p, j] += state.rotations[p, i, j] * chain.parent_offset_m[b, j]
        if p >= 0:
            for m in range(3, MOTIONS):
                if chain.coordinate[b, m] >= 0 and chain.spline[b, m] >= 0:
                    _add_translation(chain, coordinates, state, b, m, jacobian)
        b = p


@subroutine
def _add_translation(chain, coordinates, state, b, m, jacobian):
    """Add the derivatives of a translation within a joint with respect to the scale factors of the parent."""
    p = chain.parent[b]
    value, _ = _motion(chain, b, m, coordinates)
    axis, side = chain.axes[b, m], chain.parent_rotation[b]
    for i in range(3):
        direction = 0.0
        for j in range(3):
            in_parent = side[j, 0] * axis[0] + side[j, 1] * axis[1] + side[j, 2] * axis[2]
            direction += state.rotations[p, i, j] * in_parent
        for j in range(3):
            jacobian[i, p, j] += value * abs(axis[j]) * direction


@kernel
def body_poses(chain, scales, coordinates, state, rotations, origins_m):
    """Compute the poses of all bodies over frames.

    Args:
        chain: joints.
        scales: shape (body, 3): scale factors of the bodies.
        coordinates: shape (frame, coordinate), rad or m; a missing one makes the bodies beyond it missing.
        state: scratch.
        rotations: shape (frame, body, 3, 3): ``world_from_body``, written.
        origins_m: shape (frame, body, 3), written.
    """
    for t in range(coordinates.shape[0]):
        place_bodies(chain, scales, coordinates[t], state)
        rotations[t] = state.rotations
        origins_m[t] = state.origins_m


@kernel
def marker_positions(chain, scales, coordinates, state, marker_body, locations_m, positions_m):
    """Compute the positions of markers over frames.

    Args:
        chain: joints.
        scales: shape (body, 3): scale factors of the bodies.
        coordinates: shape (frame, coordinate), rad or m; a missing one makes the markers beyond it missing.
        state: scratch.
        marker_body: shape (marker,), int64.
        locations_m: shape (marker, 3): locations in the unscaled bodies.
        positions_m: shape (frame, marker, 3), written.
    """
    for t in range(coordinates.shape[0]):
        place_bodies(chain, scales, coordinates[t], state)
        for k in range(marker_body.shape[0]):
            place_marker(scales, state, marker_body[k], locations_m[k], positions_m[t, k])


@kernel
def marker_jacobians(chain, scales, coordinates, state, markers, by_coordinate, by_scale):
    """Compute the derivatives of marker positions in one frame.

    Args:
        chain: joints.
        scales: shape (body, 3): scale factors of the bodies.
        coordinates: shape (coordinate,), rad or m.
        state: bodies in this frame, written.
        markers: bodies, shape (marker,), int64, locations in the unscaled bodies, shape (marker, 3), m, and positions,
            shape (marker, 3), m, written.
        by_coordinate: shape (marker, 3, coordinate): derivatives with respect to the coordinates, written.
        by_scale: shape (marker, 3, body, 3): derivatives with respect to the scale factors, written.
    """
    place_bodies(chain, scales, coordinates, state)
    bodies, locations_m, positions_m = markers
    for k in range(bodies.shape[0]):
        place_marker(scales, state, bodies[k], locations_m[k], positions_m[k])
        coordinate_jacobian(chain, state, bodies[k], positions_m[k], by_coordinate[k])
        scale_jacobian(chain, coordinates, state, bodies[k], locations_m[k], by_scale[k])


@subroutine
def store_motion(state, rotations, angular):
    """Copy the rotations of bodies and the angular velocities per coordinate, element by element.

    An assignment of arrays would compile the message for arrays of different shapes, which takes a second.
    """
    for body in range(rotations.shape[0]):
        for i in range(3):
            for j in range(3):
                rotations[body, i, j] = state.rotations[body, i, j]
    for c in range(angular.shape[0]):
        for i in range(3):
            angular[c, i] = state.angular[c, i]
