"""Coordinates of an anatomical chain from measured markers: the most probable ones of every frame, and their errors.

The objective of a frame is the sum of the squared normalized residuals of its markers, with Huber's weight beyond
``CAP`` standard deviations, and of a Gaussian prior of the coordinates. Levenberg-Marquardt steps minimize it.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.biomechanics.chain import (
    coordinate_jacobian,
    place_bodies,
    place_marker,
    scale_jacobian,
    store_motion,
)
from posefuse.kernels.jit import kernel, subroutine
from posefuse.kernels.linear_algebra.symmetric import cholesky, cholesky_solve, invert

CAP = 3.0
"""Residual in standard deviations beyond which the influence of a marker no longer grows."""
MOST_STEPS = 30
_TOLERANCE = 1e-5
_GAIN = 1e-9


class Markers(NamedTuple):
    """Markers on a chain.

    Attributes:
        bodies: shape (marker,), int64.
        locations_m: shape (marker, 3): locations in the unscaled bodies.
        ancestors: shape (marker, most), int64: coordinates that move the marker, ascending; -1 after the last one.
    """

    bodies: Any
    locations_m: Any
    ancestors: Any


class Prior(NamedTuple):
    """Gaussian prior of coordinates.

    Attributes:
        precision: shape (coordinate, coordinate).
        mean: shape (coordinate,), rad or m.
    """

    precision: Any
    mean: Any


class Work(NamedTuple):
    """Scratch arrays for n coordinates.

    Attributes:
        hessian: shape (n, n).
        factor: shape (n, n).
        gradient: shape (n,).
        step: shape (2 n,): step of the coordinates, and scratch.
        jacobian: shape (3, n).
        position_m: shape (3,).
    """

    hessian: Any
    factor: Any
    gradient: Any
    step: Any
    jacobian: Any
    position_m: Any

    @classmethod
    def allocate(cls, n: int) -> "Work":
        """Return arrays for n coordinates."""
        return cls(np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty(2 * n), np.empty((3, n)), np.empty(3))


@subroutine
def marker_weight(information, x, y, z):
    """Return the squared normalized length of a residual, and Huber's weight."""
    square = x * (information[0, 0] * x + 2.0 * information[0, 1] * y + 2.0 * information[0, 2] * z)
    square += y * (information[1, 1] * y + 2.0 * information[1, 2] * z) + z * information[2, 2] * z
    return square, 1.0 if square <= CAP * CAP else CAP / math.sqrt(square)


@subroutine
def _add_prior(prior, coordinates, work):
    """Set the Hessian and gradient to those of the prior and return its objective."""
    n = coordinates.shape[0]
    cost = 0.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            work.hessian[i, j] = prior.precision[i, j]
            total += prior.precision[i, j] * (coordinates[j] - prior.mean[j])
        work.gradient[i] = total
        cost += total * (coordinates[i] - prior.mean[i])
    return cost


@subroutine
def _add_marker(ancestors, information, weight, residual, work):
    """Add a marker to the lower triangle of the Hessian and to the gradient."""
    jacobian = work.jacobian
    for a in range(ancestors.shape[0]):
        i = ancestors[a]
        if i < 0:
            break
        w0 = weight * (
            information[0, 0] * jacobian[0, i] + information[0, 1] * jacobian[1, i] + information[0, 2] * jacobian[2, i]
        )
        w1 = weight * (
            information[1, 0] * jacobian[0, i] + information[1, 1] * jacobian[1, i] + information[1, 2] * jacobian[2, i]
        )
        w2 = weight * (
            information[2, 0] * jacobian[0, i] + information[2, 1] * jacobian[1, i] + information[2, 2] * jacobian[2, i]
        )
        work.gradient[i] += w0 * residual[0] + w1 * residual[1] + w2 * residual[2]
        for b in range(a + 1):
            j = ancestors[b]
            work.hessian[i, j] += w0 * jacobian[0, j] + w1 * jacobian[1, j] + w2 * jacobian[2, j]


@subroutine
def frame_equations(model, state, frame, prior, coordinates, work):
    """Set the lower triangle of the Hessian and the gradient of a frame, and return its objective."""
    chain, scales, markers = model
    points_m, information = frame
    place_bodies(chain, scales, coordinates, state)
    cost = _add_prior(prior, coordinates, work)
    for k in range(markers.bodies.shape[0]):
        if math.isnan(points_m[k, 0]):
            continue
        body, position_m = markers.bodies[k], work.position_m
        place_marker(scales, state, body, markers.locations_m[k], position_m)
        coordinate_jacobian(chain, state, body, position_m, work.jacobian)
        for i in range(3):
            position_m[i] -= points_m[k, i]
        square, weight = marker_weight(information[k], position_m[0], position_m[1], position_m[2])
        cost += square if weight == 1.0 else CAP * (2.0 * math.sqrt(square) - CAP)
        _add_marker(markers.ancestors[k], information[k], weight, position_m, work)
    return cost


@subroutine
def _damped_step(work, damping):
    """Set the step; return False if the damped Hessian is not positive definite."""
    n = work.gradient.shape[0]
    for i in range(n):
        for j in range(i + 1):
            work.factor[i, j] = work.hessian[i, j]
        work.factor[i, i] *= 1.0 + damping
        work.step[i] = -work.gradient[i]
    if not cholesky(work.factor, n):
        return False
    cholesky_solve(work.factor, n, work.step)
    return True


@subroutine
def solve_frame(model, state, frame, prior, coordinates, work):
    """Minimize the objective of a frame from ``coordinates`` on, which are overwritten, and return its value.

    The work arrays then hold the equations at the minimum.
    """
    n = coordinates.shape[0]
    cost = frame_equations(model, state, frame, prior, coordinates, work)
    damping = 1e-6
    for _ in range(MOST_STEPS):
        if not _damped_step(work, damping):
            damping = 10.0 * damping + 1e-3
            continue
        largest = 0.0
        for i in range(n):
            largest = max(largest, abs(work.step[i]))
        for i in range(n):
            coordinates[i] += work.step[i]
        if largest < _TOLERANCE:
            break
        # The step is undone if the objective grows; its equations are then set up again.
        new = frame_equations(model, state, frame, prior, coordinates, work)
        if new <= cost * (1.0 + _GAIN):
            done = cost - new < 1e-6 * cost and largest < 1e-3
            cost, damping = new, max(0.1 * damping, 1e-9)
            if done:
                return cost
        else:
            for i in range(n):
                coordinates[i] -= work.step[i]
            damping = 10.0 * damping + 1e-4
            frame_equations(model, state, frame, prior, coordinates, work)
    return frame_equations(model, state, frame, prior, coordinates, work)


@kernel
def solve_frames(model, frames, prior, first, state, work, out):
    """Estimate the coordinates of consecutive frames; each starts at the coordinates of the one before.

    Args:
        model: chain, scale factors of shape (body, 3), and :class:`Markers`.
        frames: points, shape (frame, marker, 3), m, NaN where missing; their information, shape (frame, marker, 3, 3),
            m^-2; and which frames to solve, shape (frame,), bool.
        prior: :class:`Prior`.
        first: shape (coordinate,): coordinates to start from.
        state: scratch of the chain.
        work: :class:`Work`.
        out: written where solved: coordinates, shape (frame, coordinate); covariance, shape (frame, coordinate,
            coordinate); rotations of bodies, shape (frame, body, 3, 3); angular velocities per coordinate, shape
            (frame, coordinate, 3); objective, shape (frame,).
    """
    points_m, information, solvable = frames
    coordinates, covariance, rotations, angular, cost = out
    n = first.shape[0]
    current, other = first.copy(), first.copy()
    bound = 9.0 * points_m.shape[1]
    for t in range(points_m.shape[0]):
        if not solvable[t]:
            continue
        frame = (points_m[t], information[t])
        cost[t] = solve_frame(model, state, frame, prior, current, work)
        if cost[t] > bound:
            # Another start avoids a local minimum far from the frame before.
            for i in range(n):
                other[i] = prior.mean[i]
            again = solve_frame(model, state, frame, prior, other, work)
            if again < cost[t]:
                for i in range(n):
                    current[i] = other[i]
            cost[t] = solve_frame(model, state, frame, prior, current, work)
        store_motion(state, rotations[t], angular[t])
        for i in range(n):
            coordinates[t, i] = current[i]
            for j in range(i + 1):
                work.hessian[j, i] = work.hessian[i, j]
        invertible = invert(work.hessian, n, work.step)
        for i in range(n):
            for j in range(n):
                covariance[t, i, j] = work.hessian[i, j] if invertible else np.nan


@subroutine
def parameter_jacobian(model, state, coordinates, k, basis, by_scale, jacobian):
    """Write the derivatives of a marker with respect to scale parameters and to its own location, shape (3, s + 3)."""
    chain, scales, markers = model
    body = markers.bodies[k]
    scale_jacobian(chain, coordinates, state, body, markers.locations_m[k], by_scale)
    n_scales = basis.shape[2]
    for i in range(3):
        for s in range(n_scales):
            total = 0.0
            for b in range(basis.shape[0]):
                for a in range(3):
                    total += by_scale[i, b, a] * scales[b, a] * basis[b, a, s]
            jacobian[i, s] = total
        for a in range(3):
            jacobian[i, n_scales + a] = state.rotations[body, i, a] * scales[body, a]


@kernel
def parameter_equations(model, basis, frame, coordinates, state, out):
    """Add the equations of a frame in the constant parameters of a person at solved coordinates.

    The parameters are the logarithms of scales and then the deviations of all markers from their locations.

    Args:
        model: chain, scale factors, and :class:`Markers`.
        basis: shape (body, 3, scale): derivatives of the logarithms of scale factors.
        frame: points, shape (marker, 3), and information, shape (marker, 3, 3).
        coordinates: shape (coordinate,).
        state: scratch of the chain.
        out: to which are added: Hessian, shape (parameter, parameter); mixed second derivatives, shape (coordinate,
            parameter); gradient, shape (parameter,).
    """
    chain, scales, markers = model
    points_m, information = frame
    hessian, mixed, gradient = out
    n_scales, n_markers = basis.shape[2], markers.bodies.shape[0]
    own, weighted = np.empty((3, n_scales + 3)), np.empty((3, n_scales + 3))
    by_scale = np.empty((3, basis.shape[0], 3))
    by_coordinate, position_m = np.empty((3, coordinates.shape[0])), np.empty(3)
    place_bodies(chain, scales, coordinates, state)
    for k in range(n_markers):
        if math.isnan(points_m[k, 0]):
            continue
        place_marker(scales, state, markers.bodies[k], markers.locations_m[k], position_m)
        coordinate_jacobian(chain, state, markers.bodies[k], position_m, by_coordinate)
        parameter_jacobian(model, state, coordinates, k, basis, by_scale, own)
        for i in range(3):
            position_m[i] -= points_m[k, i]
        _, weight = marker_weight(information[k], position_m[0], position_m[1], position_m[2])
        for p in range(n_scales + 3):
            for i in range(3):
                weighted[i, p] = weight * (
                    information[k, i, 0] * own[0, p]
                    + information[k, i, 1] * own[1, p]
                    + information[k, i, 2] * own[2, p]
                )
        for p in range(n_scales + 3):
            to = p if p < n_scales else p + 3 * k
            for i in range(3):
                gradient[to] += weighted[i, p] * position_m[i]
                for q in range(n_scales + 3):
                    hessian[to, q if q < n_scales else q + 3 * k] += weighted[i, p] * own[i, q]
            for a in range(markers.ancestors.shape[1]):
                c = markers.ancestors[k, a]
                if c < 0:
                    break
                for i in range(3):
                    mixed[c, to] += by_coordinate[i, c] * weighted[i, p]
