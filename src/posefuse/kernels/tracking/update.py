"""Update of articulated bodies directly from the pixels of assigned detections.

An update is an iterated extended Kalman filter: Gauss-Newton on squared pixel residuals, robust by a Student t
distribution, with the prediction as prior, in pose and shape only. Velocities follow by their correlation. See
docs/methods/tracking.md.
"""

import math
from collections import namedtuple

import numpy as np

from posefuse.kernels.jit import inline, kernel, subroutine, vectorized
from posefuse.kernels.linear_algebra.symmetric import (
    cholesky,
    cholesky_solve,
    invert,
    multiply,
    subtract_symmetric_product,
)
from posefuse.kernels.tracking.body_kinematics import apply_increment, locate_nodes, node_jacobian
from posefuse.kernels.tracking.records import UNOBSERVED, AssignedDetections, Pose
from posefuse.kernels.tracking.update_equations import Observed, build_equations, gate_observations

Workspace = namedtuple(
    "Workspace",
    "nodes jacobian noise prior hessian best_hessian lower gradient best_gradient change offset best_offset weight "
    "force weighted gain cross best_pose",
)
"""Scratch arrays of an update.

They hold node positions and their Jacobian, the noise variance of each observation, the information of the prediction,
the normal equations (current and of the best pose), the step and the offset from the prediction, the terms of one
keypoint, the velocity gain, and the best pose so far.
"""


_DAMPING = 1e-3


_SMALL_STEP = 1e-2


_DAMPING_FACTOR = 10.0


@vectorized
def update_velocities(cov, prior, posterior, offset, m, velocity, gain, cross):
    """Update velocities and the full covariance from the offset of pose and shape and their posterior covariance.

    With G = P_va P_aa^-1: velocities change by G times the offset, P_va becomes G P_aa', P_vv loses G (P_aa - P_aa')
    G^T.
    """
    n = velocity.shape[0]
    first = cov.shape[0] - n
    multiply(cov, first, prior, n, m, gain)
    multiply(gain, 0, posterior, n, m, cross)
    for i in range(n):
        for j in range(m):
            velocity[i] += gain[i, j] * offset[j]
            cov[first + i, j] -= cross[i, j]
    subtract_symmetric_product(cov, first, gain, n, m)
    _store_covariance(cov, posterior, cross, first, n, m)


@inline
def _store_covariance(cov, posterior, cross, first, n, m):
    """Store the posterior of pose and shape and its covariance with the velocities."""
    for i in range(n):
        for j in range(m):
            cov[first + i, j] = cross[i, j]
            cov[j, first + i] = cross[i, j]
    for i in range(m):
        for j in range(m):
            cov[i, j] = posterior[i, j]


@inline
def copy_vector(source, target):
    """Copy a vector."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@inline
def copy_rotations(source, target):
    """Copy rotation matrices, shape (part, 3, 3)."""
    for s in range(target.shape[0]):
        for i in range(3):
            for j in range(3):
                target[s, i, j] = source[s, i, j]


@subroutine
def _copy_pose(source, target):
    """Copy a pose and a shape."""
    copy_vector(source.root, target.root)
    copy_rotations(source.turns, target.turns)
    copy_rotations(source.bones, target.bones)
    copy_vector(source.shape, target.shape)


@inline
def copy_triangle(source, m, target):
    """Copy the lower triangle of the first ``m`` rows."""
    for i in range(m):
        for j in range(i + 1):
            target[i, j] = source[i, j]


@subroutine
def _damped_step(hessian, gradient, damping, m, lower, change):
    """Compute the damped Gauss-Newton step; return its squared length in standard deviations."""
    copy_triangle(hessian, m, lower)
    for i in range(m):
        lower[i, i] *= 1.0 + damping
        change[i] = gradient[i]
    size = 0.0
    if cholesky(lower, m):
        cholesky_solve(lower, m, change)
        for i in range(m):
            size += change[i] * gradient[i]
    else:
        for i in range(m):
            change[i] = 0.0
    return size


@kernel
def update_people(cameras, body, error_model, detections, discount, iterations, state, out):
    """Update all people with the detections assigned to them.

    Args:
        cameras: the camera array.
        body: a Body.
        error_model: an ErrorModel.
        detections: AssignedDetections.
        discount: shape (person,): information discount: the number of frames that together carry the information of
            one independent frame, because detection errors are correlated in time.
        iterations: maximum number of Gauss-Newton iterations.
        state: a State, in and out.
        out: UpdateResults, written.
    """
    use, innovation, surprise = out
    rows, labels, keypoints_px, confidence = detections
    n_people, n = state.velocity.shape
    h = state.shape.shape[1]
    size, n_views, n_keypoints = n + h, cameras.shape[0], body.keypoint_nodes.shape[0]
    workspace = Workspace(
        nodes=np.empty((body.parents.shape[0], 3)),
        jacobian=np.zeros((body.parents.shape[0], 3, size)),
        noise=np.empty((n_views, n_keypoints)),
        prior=np.empty((size, size)),
        hessian=np.empty((size, size)),
        best_hessian=np.empty((size, size)),
        lower=np.empty((size, size)),
        gradient=np.empty(size),
        best_gradient=np.empty(size),
        change=np.empty(2 * size),
        offset=np.empty(size),
        best_offset=np.empty(size),
        weight=np.empty(6),
        force=np.empty(3),
        weighted=np.empty((3, size)),
        gain=np.empty((n, size)),
        cross=np.empty((n, size)),
        best_pose=Pose(
            root=np.empty(3),
            turns=np.empty((state.turns.shape[1], 3, 3)),
            bones=np.empty((state.bones.shape[1], 3, 3)),
            shape=np.empty(h),
        ),
    )
    for p in range(n_people):
        m = size if state.free[p] != 0 else n
        cov = state.covariance[p]
        innovation[p] = math.nan
        copy_triangle(cov, m, workspace.prior)
        if not invert(workspace.prior, m, workspace.change):
            use[p, :, :] = UNOBSERVED
            surprise[p] = math.nan
            state.root[p, :] = math.nan
            continue
        observed = Observed(
            cameras, body, error_model, AssignedDetections(rows[p], labels[p], keypoints_px, confidence), use[p],
            1.0 / discount[p],
        )  # fmt: skip
        pose = Pose(state.root[p], state.turns[p], state.bones[p], state.shape[p])
        surprise[p] = _iterate(observed, pose, cov, n, m, iterations, workspace)
        innovation[p] = _finish_update(cov, m, state.velocity[p], workspace)


@subroutine
def _iterate(observed, pose, cov, n, m, iterations, workspace):
    """Iterate damped Gauss-Newton steps from the prediction; return the sum of squared innovations at the start."""
    for i in range(m):
        workspace.offset[i] = 0.0
    damping, before, surprise = 0.0, math.inf, 0.0
    for iteration in range(iterations + 1):
        locate_nodes(observed.body, pose, workspace.nodes)
        node_jacobian(observed.body, pose, n, workspace.jacobian)
        if iteration == 0:
            surprise = gate_observations(observed, cov, m, workspace)
        total = build_equations(observed, pose, m, workspace)
        if total <= before + 1e-9 * abs(before):
            before = total
            damping /= _DAMPING_FACTOR
            copy_triangle(workspace.hessian, m, workspace.best_hessian)
            copy_vector(workspace.gradient, workspace.best_gradient)
            copy_vector(workspace.offset, workspace.best_offset)
            _copy_pose(pose, workspace.best_pose)
        else:
            # The cost rose: return to the best pose and take a shorter step.
            damping = max(_DAMPING, damping * _DAMPING_FACTOR)
            _copy_pose(workspace.best_pose, pose)
            copy_vector(workspace.best_offset, workspace.offset)
        if iteration == iterations:
            break
        size = _damped_step(
            workspace.best_hessian, workspace.best_gradient, damping, m, workspace.lower, workspace.change
        )
        apply_increment(workspace.change, pose.root, pose.turns, pose.bones)
        for i in range(m - n):
            pose.shape[i] += workspace.change[n + i]
        for i in range(m):
            workspace.offset[i] += workspace.change[i]
        if size < _SMALL_STEP and damping < _DAMPING:
            break
    return surprise


@subroutine
def _finish_update(cov, m, velocity, workspace):
    """Compute the covariance after an update and the velocities; return the squared distance from the prediction."""
    distance_squared = 0.0
    for i in range(m):
        for j in range(m):
            distance_squared += workspace.offset[i] * workspace.prior[i, j] * workspace.offset[j]
    copy_triangle(workspace.best_hessian, m, workspace.hessian)
    if invert(workspace.hessian, m, workspace.change):
        update_velocities(
            cov, workspace.prior, workspace.hessian, workspace.offset, m, velocity, workspace.gain, workspace.cross
        )
    return distance_squared
