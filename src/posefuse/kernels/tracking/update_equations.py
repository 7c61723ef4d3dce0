"""Gating and normal equations of an update: observations, prior and joint limits."""

import math
from typing import Any, NamedTuple

from posefuse.kernels.cameras.lens import OK
from posefuse.kernels.jit import inline, subroutine, vectorized
from posefuse.kernels.tracking.error_model import noise_variance
from posefuse.kernels.tracking.joint_limits import TWIST, add_limit, add_twist
from posefuse.kernels.tracking.point_projection import pixel_covariance, point_covariance, project_node
from posefuse.kernels.tracking.records import GATED, UNOBSERVED, USED


class Observed(NamedTuple):
    """What an update of one person observes.

    Attributes:
        cameras: the camera array.
        body: a Body.
        error_model: an ErrorModel.
        detections: AssignedDetections of this person: rows and labels without the person axis.
        use: shape (view, keypoint), int64: USED, GATED or UNOBSERVED.
        information: factor of the information of the observations.
    """

    cameras: Any
    body: Any
    error_model: Any
    detections: Any
    use: Any
    information: Any


@subroutine
def gate_observations(observed, cov, m, workspace):
    """Gate observations at the prediction; write their use and variance; return the sum of squared innovations."""
    cameras, body, error_model, detections, use, _ = observed
    rows, labels, keypoints_px, confidence = detections
    nodes, jacobian, noise, packed = workspace.nodes, workspace.jacobian, workspace.noise, workspace.weight
    total = 0.0
    for k in range(body.keypoint_nodes.shape[0]):
        node = body.keypoint_nodes[k]
        if node >= 0:
            point_covariance(jacobian, body.starts, body.columns, node, m, cov, packed)
        for v in range(cameras.shape[0]):
            use[v, k] = UNOBSERVED
            if node < 0 or rows[v] < 0 or labels[v, k] < 0:
                continue
            keypoint_confidence = confidence[rows[v], labels[v, k]]
            pixel_u = keypoints_px[rows[v], labels[v, k], 0]
            pixel_v = keypoints_px[rows[v], labels[v, k], 1]
            if not math.isfinite(pixel_u + pixel_v) or keypoint_confidence < error_model.min_confidence:
                continue
            view = project_node(cameras, v, nodes, node)
            if view[0] != OK:
                continue
            noise[v, k] = noise_variance(error_model, v, keypoint_confidence, view)
            uu, uv, vv = pixel_covariance(view, packed)
            uu += noise[v, k]
            vv += noise[v, k]
            du = pixel_u - view[1]
            dv = pixel_v - view[2]
            squared = (vv * du * du - 2.0 * uv * du * dv + uu * dv * dv) / (uu * vv - uv * uv)
            use[v, k] = USED if squared <= error_model.gate else GATED
            if use[v, k] == USED:
                total += squared
    return total


@inline
def _clear(matrix, vector, n):
    """Reset a vector and the lower triangle of a matrix."""
    for i in range(n):
        vector[i] = 0.0
        for j in range(i + 1):
            matrix[i, j] = 0.0


@subroutine
def _add_keypoint(body, node, m, workspace):
    """Add one keypoint, with information ``weight`` (packed) and gradient ``force``, to the normal equations."""
    starts, columns, jacobian = body.starts, body.columns, workspace.jacobian
    weight, force, weighted = workspace.weight, workspace.force, workspace.weighted
    hessian, gradient = workspace.hessian, workspace.gradient
    for a in range(starts[node], starts[node + 1]):
        i = columns[a]
        if i >= m:
            break
        x, y, z = jacobian[node, 0, i], jacobian[node, 1, i], jacobian[node, 2, i]
        gradient[i] += x * force[0] + y * force[1] + z * force[2]
        weighted[0, i] = weight[0] * x + weight[1] * y + weight[2] * z
        weighted[1, i] = weight[1] * x + weight[3] * y + weight[4] * z
        weighted[2, i] = weight[2] * x + weight[4] * y + weight[5] * z
    for a in range(starts[node], starts[node + 1]):
        i = columns[a]
        if i >= m:
            break
        x, y, z = jacobian[node, 0, i], jacobian[node, 1, i], jacobian[node, 2, i]
        for b in range(starts[node], a + 1):
            j = columns[b]
            hessian[i, j] += x * weighted[0, j] + y * weighted[1, j] + z * weighted[2, j]


@subroutine
def _add_views(observed, m, workspace):
    """Add all used observations to the normal equations; return their cost."""
    cameras, body, error_model, detections, use, information = observed
    rows, labels, keypoints_px, _ = detections
    noise, nodes, weight, force = workspace.noise, workspace.nodes, workspace.weight, workspace.force
    cost = 0.0
    for k in range(body.keypoint_nodes.shape[0]):
        node = body.keypoint_nodes[k]
        any_view = False
        for e in range(6):
            weight[e] = 0.0
        for e in range(3):
            force[e] = 0.0
        for v in range(cameras.shape[0]):
            if use[v, k] != USED:
                continue
            view = project_node(cameras, v, nodes, node)
            if view[0] != OK:
                continue
            du = keypoints_px[rows[v], labels[v, k], 0] - view[1]
            dv = keypoints_px[rows[v], labels[v, k], 1] - view[2]
            squared = (du * du + dv * dv) / noise[v, k]
            cost += information * 0.5 * (error_model.nu + 2.0) * math.log(1.0 + squared / error_model.nu)
            w = information * (error_model.nu + 2.0) / (error_model.nu + squared) / noise[v, k]
            weight[0] += w * (view[3] * view[3] + view[6] * view[6])
            weight[1] += w * (view[3] * view[4] + view[6] * view[7])
            weight[2] += w * (view[3] * view[5] + view[6] * view[8])
            weight[3] += w * (view[4] * view[4] + view[7] * view[7])
            weight[4] += w * (view[4] * view[5] + view[7] * view[8])
            weight[5] += w * (view[5] * view[5] + view[8] * view[8])
            force[0] += w * (view[3] * du + view[6] * dv)
            force[1] += w * (view[4] * du + view[7] * dv)
            force[2] += w * (view[5] * du + view[8] * dv)
            any_view = True
        if any_view:
            _add_keypoint(body, node, m, workspace)
    return cost


@vectorized
def _add_prior(prior, offset, m, hessian, gradient):
    """Add the prediction as prior; return the cost of the offset from it."""
    cost = 0.0
    for i in range(m):
        weighted_offset = 0.0
        for j in range(m):
            weighted_offset += prior[i, j] * offset[j]
        for j in range(i + 1):
            hessian[i, j] += prior[i, j]
        gradient[i] -= weighted_offset
        cost += 0.5 * offset[i] * weighted_offset
    return cost


@subroutine
def build_equations(observed, pose, m, workspace):
    """Build the normal equations at a pose and shape in the workspace; return their cost."""
    body = observed.body
    _clear(workspace.hessian, workspace.gradient, m)
    total = _add_prior(workspace.prior, workspace.offset, m, workspace.hessian, workspace.gradient)
    total += _add_views(observed, m, workspace)
    stiffness = observed.error_model.limit_sigma**-2.0
    for limit in range(body.limits.shape[0]):
        if body.limits[limit, 0] == TWIST:
            total += add_twist(body, limit, stiffness, pose.turns, workspace.hessian, workspace.gradient)
        else:
            total += add_limit(body, limit, stiffness, pose.turns, pose.bones, workspace.hessian, workspace.gradient)
    return total
