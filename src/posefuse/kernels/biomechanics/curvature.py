"""Corrections for the curvature of the paths on which markers move.

Markers move on arcs, so noise displaces them, in the mean, toward the centers of the arcs. Without a correction, limbs
of noisy points are estimated too long, however many frames there are (Neyman and Scott 1948, Econometrica 16(1)), and
straight limbs seem bent.
"""

import math

import numpy as np

from posefuse.kernels.biomechanics.chain import coordinate_jacobian, place_bodies, place_marker, store_motion
from posefuse.kernels.biomechanics.inverse_kinematics import marker_weight, parameter_jacobian
from posefuse.kernels.jit import kernel, subroutine


@subroutine
def _mean_bend(ancestors, state, covariance, jacobian, bend_m):
    """Set the sum of a marker's second derivatives, each times the covariance of its two coordinates.

    The second derivative of a position is the axis of the earlier coordinate times the derivative by the later one.
    Translations of the pelvis come before all rotations.
    """
    bend_m[:] = 0.0
    for a in range(ancestors.shape[0]):
        d = ancestors[a]
        if d < 0:
            break
        turn = state.angular[d]
        if turn[0] == 0.0 and turn[1] == 0.0 and turn[2] == 0.0:
            continue
        x = y = z = 0.0
        for b in range(a + 1):
            c = ancestors[b]
            twice = covariance[c, d] if b == a else 2.0 * covariance[c, d]
            x += twice * state.angular[c, 0]
            y += twice * state.angular[c, 1]
            z += twice * state.angular[c, 2]
        bend_m[0] += y * jacobian[2, d] - z * jacobian[1, d]
        bend_m[1] += z * jacobian[0, d] - x * jacobian[2, d]
        bend_m[2] += x * jacobian[1, d] - y * jacobian[0, d]


@subroutine
def _pull(information, weight, bend_m):
    """Replace a mean bend by half of its product with the information of its marker."""
    x, y, z = bend_m[0], bend_m[1], bend_m[2]
    for i in range(3):
        bend_m[i] = 0.5 * weight * (information[i, 0] * x + information[i, 1] * y + information[i, 2] * z)


@kernel
def bend_equations(model, basis, frame, coordinates, covariance, state, out):
    """Add the mean of a frame's gradient that is due to noise, to second order.

    Args:
        model: chain, scale factors, and markers.
        basis: shape (body, 3, scale): derivatives of the logarithms of scale factors.
        frame: points, shape (marker, 3), and information, shape (marker, 3, 3).
        coordinates: shape (coordinate,).
        covariance: shape (coordinate, coordinate): covariance of the coordinates.
        state: scratch of the chain.
        out: to which are added: shape (coordinate,), and shape (parameter,). The parameters are the logarithms of
            scales and then the deviations of all markers from their locations.
    """
    chain, scales, markers = model
    points_m, information = frame
    by_coordinate, by_parameter = out
    n, n_scales = coordinates.shape[0], basis.shape[2]
    jacobian, own, position_m = np.empty((3, n)), np.empty((3, n_scales + 3)), np.empty(3)
    bend, by_scale = np.empty(3), np.empty((3, basis.shape[0], 3))
    place_bodies(chain, scales, coordinates, state)
    for k in range(markers.bodies.shape[0]):
        if math.isnan(points_m[k, 0]):
            continue
        place_marker(scales, state, markers.bodies[k], markers.locations_m[k], position_m)
        coordinate_jacobian(chain, state, markers.bodies[k], position_m, jacobian)
        position_m -= points_m[k]
        _, weight = marker_weight(information[k], position_m[0], position_m[1], position_m[2])
        _mean_bend(markers.ancestors[k], state, covariance, jacobian, bend)
        _pull(information[k], weight, bend)
        parameter_jacobian(model, state, coordinates, k, basis, by_scale, own)
        for i in range(3):
            for c in range(n):
                by_coordinate[c] += jacobian[i, c] * bend[i]
            for p in range(n_scales + 3):
                by_parameter[p if p < n_scales else p + 3 * k] += own[i, p] * bend[i]


@subroutine
def _weighted_rows(ancestors, covariance, information, weight, jacobian, rows):
    """Set ``rows``, shape (coordinate, 3), to the covariance times the transposed Jacobian times the information."""
    for a in range(ancestors.shape[0]):
        c = ancestors[a]
        if c < 0:
            break
        x = y = z = 0.0
        for b in range(ancestors.shape[0]):
            d = ancestors[b]
            if d < 0:
                break
            x += covariance[c, d] * jacobian[0, d]
            y += covariance[c, d] * jacobian[1, d]
            z += covariance[c, d] * jacobian[2, d]
        for i in range(3):
            rows[c, i] = weight * (information[0, i] * x + information[1, i] * y + information[2, i] * z)


@subroutine
def _add_volume(ancestors, state, jacobian, rows, gradient):
    """Add a marker's part of the derivatives of half of the log determinant of the Hessian by the coordinates."""
    for a in range(ancestors.shape[0]):
        c = ancestors[a]
        if c < 0:
            break
        for b in range(ancestors.shape[0]):
            d = ancestors[b]
            if d < 0:
                break
            w, far = (state.angular[c], d) if c <= d else (state.angular[d], c)
            turn = state.angular[far]
            if turn[0] == 0.0 and turn[1] == 0.0 and turn[2] == 0.0:
                continue
            gradient[d] += (
                rows[c, 0] * (w[1] * jacobian[2, far] - w[2] * jacobian[1, far])
                + rows[c, 1] * (w[2] * jacobian[0, far] - w[0] * jacobian[2, far])
                + rows[c, 2] * (w[0] * jacobian[1, far] - w[1] * jacobian[0, far])
            )


@subroutine
def _shift(covariance, gradient, coordinates):
    """Move the coordinates to their means, by at most one standard deviation."""
    n, most = coordinates.shape[0], 1.0
    for c in range(n):
        total = 0.0
        for d in range(n):
            total += covariance[c, d] * gradient[d]
        most = max(most, abs(total) / math.sqrt(covariance[c, c]))
    for c in range(n):
        for d in range(n):
            coordinates[c] -= covariance[c, d] * gradient[d] / most


@kernel
def move_to_means(model, frames, state, solution):
    """Move the coordinates of frames from their most probable values to their means, to second order.

    The means differ by the covariance times half of the third derivatives of the objective, contracted with the
    covariance (Tierney and Kadane 1986, JASA 81). Third derivatives of positions are left out.

    Args:
        model: chain, scale factors, and markers.
        frames: points, shape (frame, marker, 3), and information, shape (frame, marker, 3, 3).
        state: scratch of the chain.
        solution: coordinates, shape (frame, coordinate), NaN where not solved; their covariance, shape (frame,
            coordinate, coordinate); rotations of bodies, shape (frame, body, 3, 3); angular velocities, shape (frame,
            coordinate, 3). All but the covariance are overwritten.
    """
    chain, scales, markers = model
    points_m, information = frames
    coordinates, covariance, rotations, angular = solution
    n = coordinates.shape[1]
    jacobian, rows, position_m, bend = np.empty((3, n)), np.empty((n, 3)), np.empty(3), np.empty(3)
    volume, gradient = np.empty(n), np.empty(n)
    for t in range(coordinates.shape[0]):
        if math.isnan(covariance[t, 0, 0]) or math.isnan(coordinates[t, 0]):
            continue
        volume[:], gradient[:] = 0.0, 0.0
        place_bodies(chain, scales, coordinates[t], state)
        for k in range(markers.bodies.shape[0]):
            if math.isnan(points_m[t, k, 0]):
                continue
            ancestors, precision = markers.ancestors[k], information[t, k]
            place_marker(scales, state, markers.bodies[k], markers.locations_m[k], position_m)
            coordinate_jacobian(chain, state, markers.bodies[k], position_m, jacobian)
            for i in range(3):
                position_m[i] -= points_m[t, k, i]
            _, weight = marker_weight(precision, position_m[0], position_m[1], position_m[2])
            _weighted_rows(ancestors, covariance[t], precision, weight, jacobian, rows)
            _add_volume(ancestors, state, jacobian, rows, volume)
            _mean_bend(ancestors, state, covariance[t], jacobian, bend)
            _pull(precision, weight, bend)
            for i in range(3):
                for c in range(n):
                    gradient[c] += jacobian[i, c] * bend[i]
        for c in range(n):
            gradient[c] += volume[c]
        _shift(covariance[t], gradient, coordinates[t])
        place_bodies(chain, scales, coordinates[t], state)
        store_motion(state, rotations[t], angular[t])
